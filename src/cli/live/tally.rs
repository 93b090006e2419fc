//! What a video took and gave, added up in constant memory; each frame's own line goes to the log.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use liveview::image_io::ImageRgb;
use liveview::live::{LiveFrame, LiveTimes, Taken};
use liveview::metrics::{psnr, ssim};
use serde_json::{Value, json};

use crate::cli::SCORE_BORDER;
use crate::cli::output::temporary;

/// Stages of a frame, in order.
pub(super) const STAGES: [&str; 5] = ["photos", "layers", "warp", "network", "composite"];
/// Memory is told at this many frames of the video, or half as many.
const SAMPLES: usize = 256;

fn stages(times: &LiveTimes) -> [Duration; 5] {
    [times.photos, times.layers, times.stages.warp, times.stages.network, times.stages.composite]
}

/// Durations by the millisecond, up to ten seconds.
pub(super) struct Latencies(Vec<u64>);

impl Latencies {
    pub(super) fn new() -> Self {
        Self(vec![0; 10_001])
    }

    pub(super) fn add(&mut self, latency: Duration) {
        let last = self.0.len() - 1;
        self.0[(latency.as_millis() as usize).min(last)] += 1;
    }

    /// Milliseconds that this part of them does not exceed; `None` of none.
    pub(super) fn percentile(&self, part: f64) -> Option<usize> {
        let total: u64 = self.0.iter().sum();
        let wanted = (part * total as f64).ceil().max(1.0) as u64;
        let mut below = 0;
        self.0.iter().position(|&count| {
            below += count;
            below >= wanted
        })
    }
}

/// A frame against its truth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scores {
    pub(super) psnr: f64,
    pub(super) ssim: f64,
    /// Mean |change of the picture − change of the truth| since the frame before, of 1.
    pub(super) flicker: Option<f64>,
}

/// Scores the frames of a video.
#[derive(Default)]
pub(super) struct Scorer {
    before: Option<(ImageRgb, ImageRgb)>,
}

impl Scorer {
    pub(super) fn score(&mut self, picture: &ImageRgb, truth: ImageRgb) -> Option<Scores> {
        let scores = Scores {
            psnr: psnr(picture, &truth, SCORE_BORDER),
            ssim: ssim(picture, &truth, SCORE_BORDER),
            flicker: self
                .before
                .as_ref()
                .map(|(before, truth_before)| flicker([before, picture], [truth_before, &truth])),
        };
        self.before = Some((picture.clone(), truth));
        Some(scores).filter(|scores| !scores.psnr.is_nan() && !scores.ssim.is_nan())
    }

    /// The frame to come does not follow the one before.
    pub(super) fn interrupt(&mut self) {
        self.before = None;
    }
}

fn flicker(pictures: [&ImageRgb; 2], truths: [&ImageRgb; 2]) -> f64 {
    let (width, height) = (truths[1].width(), truths[1].height());
    let (mut sum, mut count) = (0.0, 0.0);
    for y in SCORE_BORDER..height.saturating_sub(SCORE_BORDER) {
        let row = 3 * (y * width + SCORE_BORDER)..3 * ((y + 1) * width - SCORE_BORDER);
        let [before, now, truth_before, truth] =
            [pictures[0], pictures[1], truths[0], truths[1]].map(|picture| &picture.data()[row.clone()]);
        for i in 0..before.len() {
            sum += f64::from(((now[i] - before[i]) - (truth[i] - truth_before[i])).abs());
            count += 1.0;
        }
    }
    sum / count
}

/// Sums over the frames.
#[derive(Default)]
pub(super) struct Tally {
    pub(super) rendered: usize,
    pub(super) repeated: usize,
    pub(super) dropped: usize,
    taken: BTreeMap<String, usize>,
    refreshed: f64,
    spent: [Duration; 5],
    /// PSNR, SSIM and flicker: sums and counts.
    scores: [(f64, usize); 3],
    memory: Vec<(usize, u64)>,
    stride: usize,
    frames: usize,
    log: Option<Log>,
}

struct Log {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Tally {
    /// With each frame's line in `log`, if given.
    pub(super) fn new(log: Option<&Path>) -> Result<Self> {
        let open = |path: &Path| {
            let file = File::create(temporary(path))
                .with_context(|| format!("--log {}: cannot be written", path.display()))?;
            Ok::<_, anyhow::Error>(Log { path: path.to_owned(), file: BufWriter::new(file) })
        };
        Ok(Self { stride: 1, log: log.map(open).transpose()?, ..Self::default() })
    }

    pub(super) fn add(&mut self, step: usize, frame: &LiveFrame, scores: Option<Scores>) -> Result<()> {
        self.rendered += 1;
        *self.taken.entry(frame.taken.to_string()).or_default() += 1;
        if let Taken::Carried { refreshed } = frame.taken {
            self.refreshed += refreshed;
        }
        let spent = stages(&frame.times);
        self.spent.iter_mut().zip(spent).for_each(|(sum, spent)| *sum += spent);
        if let Some(Scores { psnr, ssim, flicker }) = scores {
            for (sum, score) in self.scores.iter_mut().zip([Some(psnr), Some(ssim), flicker]) {
                if let Some(score) = score {
                    *sum = (sum.0 + score, sum.1 + 1);
                }
            }
        }
        let times: serde_json::Map<String, Value> =
            STAGES.iter().zip(spent).map(|(stage, spent)| ((*stage).to_owned(), json!(spent.as_secs_f64()))).collect();
        let refreshed = if let Taken::Carried { refreshed } = frame.taken { refreshed } else { 0.0 };
        self.line(json!({
            "frame": step, "taken": frame.taken.to_string(), "refreshed": refreshed, "views": frame.views, "seconds": times,
            "psnr": scores.map(|s| s.psnr), "ssim": scores.map(|s| s.ssim), "flicker": scores.and_then(|s| s.flicker),
        }))
    }

    pub(super) fn repeat(&mut self, step: usize, why: &str) -> Result<()> {
        self.repeated += 1;
        self.line(json!({ "frame": step, "taken": "repeated", "why": why }))
    }

    fn line(&mut self, mut line: Value) -> Result<()> {
        let memory = resident();
        if let Some(bytes) = memory.filter(|_| self.frames.is_multiple_of(self.stride)) {
            self.memory.push((self.frames, bytes));
            if self.memory.len() > SAMPLES {
                self.stride *= 2;
                let stride = self.stride;
                self.memory.retain(|(frame, _)| frame.is_multiple_of(stride));
            }
        }
        self.frames += 1;
        let Some(log) = &mut self.log else { return Ok(()) };
        line["memory_bytes"] = json!(memory);
        writeln!(log.file, "{line}").with_context(|| format!("--log {}", log.path.display()))
    }

    /// Closes the log.
    pub(super) fn finish(&mut self) -> Result<()> {
        let Some(mut log) = self.log.take() else { return Ok(()) };
        log.file
            .flush()
            .and_then(|()| std::fs::rename(temporary(&log.path), &log.path))
            .with_context(|| format!("--log {}: cannot be written", log.path.display()))
    }

    fn mean(&self, which: usize) -> Option<f64> {
        let (sum, count) = self.scores[which];
        (count > 0).then(|| sum / count as f64)
    }

    /// Mean PSNR, SSIM and flicker.
    pub(super) fn scores(&self) -> Option<(f64, f64, Option<f64>)> {
        Some((self.mean(0)?, self.mean(1)?, self.mean(2)))
    }

    /// Mean seconds of each stage per rendered frame.
    pub(super) fn seconds(&self) -> [f64; 5] {
        self.spent.map(|spent| spent.as_secs_f64() / self.rendered.max(1) as f64)
    }

    /// How the frames got their layers, in words.
    pub(super) fn taken(&self) -> String {
        let told: Vec<String> = self.taken.iter().map(|(taken, frames)| format!("{taken} {frames}")).collect();
        let share = self.refreshed / self.rendered.max(1) as f64;
        let refreshed = if share > 0.0 {
            format!("; {:.1} % of a frame refreshed on average", 100.0 * share)
        } else {
            String::new()
        };
        told.join(", ") + &refreshed
    }

    /// Memory in use at the first frames and at the last.
    pub(super) fn memory(&self) -> Option<(u64, u64)> {
        Some((self.memory.first()?.1, self.memory.last()?.1))
    }

    pub(super) fn json(&self) -> Value {
        let seconds: serde_json::Map<String, Value> =
            STAGES.iter().zip(self.seconds()).map(|(stage, seconds)| ((*stage).to_owned(), json!(seconds))).collect();
        json!({
            "rendered": self.rendered, "repeated": self.repeated, "dropped": self.dropped, "taken": self.taken,
            "refreshed_share": self.refreshed / self.rendered.max(1) as f64, "seconds_per_frame": seconds,
            "mean": { "psnr": self.mean(0), "ssim": self.mean(1), "flicker": self.mean(2) },
            "memory_bytes": self.memory,
        })
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        // Gone already, unless something failed, which has been told.
        let _ = std::fs::remove_file(temporary(&self.path));
    }
}

/// Memory in use now, in bytes, where the system tells.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix(" kB"))?;
    Some(1024 * kilobytes.trim().parse::<u64>().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_by_the_millisecond() {
        let mut latencies = Latencies::new();
        assert_eq!(latencies.percentile(0.5), None);
        (1..=100).for_each(|ms| latencies.add(Duration::from_millis(ms)));
        latencies.add(Duration::from_secs(60));
        assert_eq!(latencies.percentile(0.5), Some(51));
        assert_eq!((latencies.percentile(0.99), latencies.percentile(1.0)), (Some(100), Some(10_000)));
    }

    #[test]
    fn flicker_is_the_change_that_the_truth_does_not_make() {
        let flat = |value: f32| ImageRgb::new(40, 40, vec![value; 4800]).unwrap();
        let mut scorer = Scorer::default();
        assert!(scorer.score(&flat(0.5), flat(0.4)).unwrap().flicker.is_none());
        let steady = scorer.score(&flat(0.7), flat(0.6)).unwrap().flicker.unwrap();
        let flickers = scorer.score(&flat(0.6), flat(0.6)).unwrap().flicker.unwrap();
        assert!(steady < 1e-6 && (flickers - 0.1).abs() < 1e-6, "{steady} {flickers}");
    }

    #[test]
    fn memory_is_told_at_few_frames_however_many_there_are() {
        let mut tally = Tally::new(None).unwrap();
        (0..5000).for_each(|step| tally.repeat(step, "test").unwrap());
        assert!(tally.memory.len() <= SAMPLES && tally.memory.len() >= SAMPLES / 2 - 1, "{}", tally.memory.len());
    }
}
