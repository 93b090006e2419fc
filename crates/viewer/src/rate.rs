//! How many messages a client may send.

use std::time::Instant;

/// Messages per second over time …
const PER_SECOND: f64 = 200.0;
/// … and at once.
const BURST: f64 = 200.0;

/// A bucket of permits that fills with time.
#[derive(Debug)]
pub(crate) struct Rate {
    permits: f64,
    at: Instant,
}

impl Rate {
    pub(crate) fn new(now: Instant) -> Self {
        Self { permits: BURST, at: now }
    }

    /// Whether another message may come now.
    pub(crate) fn allows(&mut self, now: Instant) -> bool {
        self.permits = (self.permits + PER_SECOND * (now - self.at).as_secs_f64()).min(BURST);
        self.at = now;
        self.permits -= 1.0;
        self.permits >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_burst_and_then_the_rate() {
        let start = Instant::now();
        let mut rate = Rate::new(start);
        assert!((0..200).all(|_| rate.allows(start)));
        assert!(!rate.allows(start));
        let mut rate = Rate::new(start);
        assert!((0..10_000).all(|i| rate.allows(start + Duration::from_millis(6 * i))));
    }
}
