//! Time by stage, and memory in use.

use std::time::Duration;

use liveview::render::StageTimes;

/// Wall time of one picture, by stage.
#[derive(Debug)]
pub struct Times {
    /// Reading and decoding the photos that were not in memory yet.
    pub photos: Duration,
    /// Searching depth: the guided search, or the depth of the photos.
    pub depth: Duration,
    /// The render that planes were selected from.
    pub select: Duration,
    /// The name of the stage that computes opacities and view weights: `network`, or `blend` without one.
    pub weighting: &'static str,
    /// Warp, weighting and composite.
    pub stages: StageTimes,
}

const STAGES: usize = 6;

impl Times {
    /// Each stage by name.
    pub fn stages(&self) -> [(&'static str, Duration); STAGES] {
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

/// The most memory that the process has used so far, in bytes; on Linux only.
pub fn peak_memory() -> Option<u64> {
    status("VmHWM:")
}

/// Memory that the process uses now, in bytes; on Linux only.
pub fn resident_memory() -> Option<u64> {
    status("VmRSS:")
}

/// An amount of memory from the process's status, in bytes.
fn status(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix(field)?.trim().strip_suffix(" kB"))?;
    Some(1024 * kilobytes.trim().parse::<u64>().ok()?)
}
