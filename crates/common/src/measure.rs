//! Time of each stage, and memory in use.

use std::time::Duration;

use liveview::render::StageTimes;

/// Wall time of each stage of one picture.
#[derive(Debug)]
pub struct Times {
    /// Reading and decoding the photos that were not in memory.
    pub photos: Duration,
    /// Searching depth: the guided search, or the depth of the photos.
    pub depth: Duration,
    /// The render that planes were selected from.
    pub select: Duration,
    /// The name of the stage that computes opacities and view weights: `network`, or `blend`
    /// without one.
    pub weighting: &'static str,
    /// Warp, weighting and composite.
    pub stages: StageTimes,
}

impl Times {
    /// The name and time of each stage.
    pub fn stages(&self) -> [(&'static str, Duration); 6] {
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
    pub fn total(&self) -> Duration {
        self.stages().iter().map(|(_, time)| *time).sum()
    }
}

/// A duration as text.
pub fn time_text(time: Duration) -> String {
    match time.as_secs_f64() {
        seconds if seconds >= 10.0 => format!("{seconds:.1} s"),
        seconds if seconds >= 0.01 => format!("{:.0} ms", 1e3 * seconds),
        seconds => format!("{:.1} ms", 1e3 * seconds),
    }
}

/// Peak memory of the process in bytes; `None` if not on Linux.
pub fn peak_memory() -> Option<u64> {
    status("VmHWM:")
}

/// Current memory of the process in bytes; `None` if not on Linux.
pub fn resident_memory() -> Option<u64> {
    status("VmRSS:")
}

/// A field of the process status, in bytes.
fn status(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix(field)?.trim().strip_suffix(" kB"))?;
    Some(1024 * kilobytes.trim().parse::<u64>().ok()?)
}
