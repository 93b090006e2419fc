//! Measures one configuration of `liveview sweep`.

use std::path::Path;

use anyhow::{Context, Result, bail};
use liveview::ImageRgb;
use liveview::image::Score;
use ndarray::Array3;
use serde_json::json;

use super::rows::Row;
use crate::worker_process::{WorkerProcess, text_of};

/// A worker, with its measurements so far.
pub(super) struct Measured {
    pub(super) worker: WorkerProcess,
    pub(super) row: Row,
}

impl Measured {
    /// Renders every target once and scores the pictures against the photos; a reference implementation renders only the
    /// first.
    pub(super) fn warm_up(&mut self, truths: &[ImageRgb], folder: &Path) -> Result<()> {
        let truths = if self.row.reference { &truths[..1] } else { truths };
        let mut scores = Vec::new();
        for (target, truth) in truths.iter().enumerate() {
            let frame = folder.join("frame.npy");
            let answer = self.worker.ask(&json!({ "run": true, "target": target, "frame": text_of(&frame)? }))?;
            let pixels: Array3<f32> = ndarray_npy::read_npy(&frame).context("a worker's picture cannot be read")?;
            let (height, width, _) = pixels.dim();
            let picture = ImageRgb::new(width, height, pixels.iter().copied().collect())?;
            scores.push(Score::of(&picture, truth));
            if target == 0 {
                let stage = if self.row.along_surface() { "depth" } else { "select" };
                self.row.once = answer["seconds"][stage].as_f64().unwrap_or(0.0);
            }
            if let Some(count) = answer["layers"].as_u64() {
                self.row.count = count as usize;
            }
        }
        let scored: Option<Vec<Score>> = scores.into_iter().collect();
        let mean = |scores: Vec<Score>| {
            let mean_of = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
            Score { psnr: mean_of(|score| score.psnr), ssim: mean_of(|score| score.ssim) }
        };
        self.row.score = scored.map(mean).filter(|score| score.psnr.is_finite() && score.ssim.is_finite());
        Ok(())
    }

    /// Renders the first target again and records the times.
    pub(super) fn time(&mut self) -> Result<()> {
        let answer = self.worker.ask(&json!({ "run": true, "target": 0 }))?;
        let Some(seconds) = answer["seconds"].as_object() else {
            bail!("{}: the answer has no times; expected `seconds`", self.row.engine)
        };
        let stages = seconds.iter().map(|(stage, time)| (stage.clone(), time.as_f64().unwrap_or(f64::NAN)));
        self.row.runs.push(stages.collect());
        self.row.peak_memory_bytes = answer["peak_memory_bytes"].as_u64();
        Ok(())
    }

    /// The row, with all its measurements.
    pub(super) fn finish(mut self) -> Row {
        if self.row.along_surface() {
            // Each picture searches its surface; what the first takes longer is the depth of the photos.
            let surface = self.row.stages().into_iter().find_map(|(stage, time)| (stage == "depth").then_some(time));
            self.row.once = (self.row.once - surface.unwrap_or(0.0)).max(0.0);
        }
        self.row
    }
}
