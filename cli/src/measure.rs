//! What a picture costs: time by stage, and memory.

use std::time::Duration;

use liveview::render::StageTimes;

/// Wall time of one picture, by stage.
pub(crate) struct Times {
    /// Reading and decoding those photos that were not in memory yet.
    pub(crate) photos: Duration,
    /// The guided search.
    pub(crate) coarse: Duration,
    /// The render that planes were selected from.
    pub(crate) select: Duration,
    pub(crate) stages: StageTimes,
}

const STAGES: usize = 6;

impl Times {
    /// Each stage by name.
    pub(crate) fn stages(&self) -> [(&'static str, Duration); STAGES] {
        let Self { photos, coarse, select, stages } = *self;
        [
            ("photos", photos),
            ("coarse", coarse),
            ("select", select),
            ("warp", stages.warp),
            ("network", stages.network),
            ("composite", stages.composite),
        ]
    }

    /// All of it.
    pub(crate) fn total(&self) -> Duration {
        self.stages().iter().map(|(_, time)| *time).sum()
    }
}

/// In words.
pub(crate) fn in_words(time: Duration) -> String {
    match time.as_secs_f64() {
        seconds if seconds >= 10.0 => format!("{seconds:.1} s"),
        seconds if seconds >= 0.01 => format!("{:.0} ms", 1e3 * seconds),
        seconds => format!("{:.1} ms", 1e3 * seconds),
    }
}

/// The most memory that the process has held so far, where the system tells it (Linux).
pub(crate) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"))?;
    Some(1024 * kilobytes.trim().parse::<u64>().ok()?)
}
