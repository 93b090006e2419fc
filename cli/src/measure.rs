//! Time of each stage; quantiles.

use std::time::Duration;

use liveview::render::StageTimes;

/// Wall time of each stage of one picture.
#[derive(Debug)]
pub(crate) struct Times {
    /// Reading and decoding the photos that were not in memory.
    pub(crate) photos: Duration,
    /// Searching depth: the guided search, or the depth of the photos.
    pub(crate) depth: Duration,
    /// The render that planes were selected from.
    pub(crate) select: Duration,
    /// The name of the stage that computes opacities and view weights: `network`, or `blend`
    /// without one.
    pub(crate) weighting: &'static str,
    /// Warp, weighting and composite.
    pub(crate) stages: StageTimes,
}

impl Times {
    /// The name and time of each stage.
    pub(crate) fn stages(&self) -> [(&'static str, Duration); 6] {
        let Self { photos, depth, select, weighting, stages } = *self;
        [
            ("photos", photos),
            ("depth", depth),
            ("select", select),
            ("warp", stages.warp),
            (weighting, stages.network),
            ("composite", stages.composite),
        ]
    }

    /// The sum of all stages.
    pub(crate) fn total(&self) -> Duration {
        self.stages().iter().map(|(_, time)| *time).sum()
    }
}

/// A duration as text.
pub(crate) fn time_text(time: Duration) -> String {
    match time.as_secs_f64() {
        seconds if seconds >= 10.0 => format!("{seconds:.1} s"),
        seconds if seconds >= 0.01 => format!("{:.0} ms", 1e3 * seconds),
        seconds => format!("{:.1} ms", 1e3 * seconds),
    }
}

/// A quantile (`fraction` from 0 to 1) of the values, which it sorts, interpolated linearly between ranks as in NumPy; NaN if
/// there are none.
pub(crate) fn quantile(values: &mut [f64], fraction: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = fraction * values.len().saturating_sub(1) as f64;
    match (values.get(at.floor() as usize), values.get(at.ceil() as usize)) {
        // Depths may be infinite, and infinity minus infinity is NaN.
        (Some(low), Some(high)) if low == high => *low,
        (Some(low), Some(high)) => low + at.fract() * (high - low),
        _ => f64::NAN,
    }
}
