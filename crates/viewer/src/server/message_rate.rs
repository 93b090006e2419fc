//! A limit on the number of messages that a client may send.

use std::time::Instant;

/// Messages per second that are allowed in the long run.
const PER_SECOND: f64 = 200.0;
/// Messages that are allowed at once.
const BURST: f64 = 200.0;

/// A token bucket.
#[derive(Debug)]
pub(crate) struct MessageRate {
    tokens: f64,
    filled_at: Instant,
}

impl MessageRate {
    pub(crate) fn new(now: Instant) -> Self {
        Self { tokens: BURST, filled_at: now }
    }

    /// Counts a message; whether it is allowed.
    pub(crate) fn allows(&mut self, now: Instant) -> bool {
        self.tokens = (self.tokens + PER_SECOND * (now - self.filled_at).as_secs_f64()).min(BURST);
        self.filled_at = now;
        self.tokens -= 1.0;
        self.tokens >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_burst_is_allowed_then_the_long_term_rate() {
        let start = Instant::now();
        let mut rate = MessageRate::new(start);
        assert!((0..200).all(|_| rate.allows(start)));
        assert!(!rate.allows(start));
        let mut rate = MessageRate::new(start);
        assert!((0..10_000).all(|i| rate.allows(start + Duration::from_millis(6 * i))));
    }
}
