//! The true depth of a scene: a folder `depth` in the scene folder with a 16-bit PNG per view and
//! `scale.json`, as in `tests/scenes/workshop`. Disparity 1/z = value · delta_max / 65535; 0 means
//! unknown.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::image;
use liveview_files::bounded;
use liveview_scene::View;
use liveview_synthesizer::{Scene, ViewDepth};
use ndarray::Array2;
use serde_json::Value;

use crate::args::output::stem;

/// Error bounds of the reported shares, in pixels of parallax.
pub(super) const WITHIN: [f32; 3] = [0.5, 1.0, 2.0];

/// The true depth of a scene.
pub(super) struct Truth {
    folder: PathBuf,
    delta_max: f64,
}

/// Shares (0 to 1) of the pixels within [`WITHIN`] pixels of parallax of the truth, among those
/// with known truth.
#[derive(Clone, Copy)]
pub(super) struct Score {
    pub(super) confirmed: [f64; 3],
    pub(super) all: [f64; 3],
}

impl Truth {
    /// Opens the true depth of a scene, if it has any.
    pub(super) fn open(scene: &Scene) -> Result<Option<Self>> {
        let folder = scene.root.join("depth");
        let path = folder.join("scale.json");
        if !path.is_file() {
            return Ok(None);
        }
        let text = bounded::read_text(&path, bounded::MAX_JSON_BYTES).with_context(|| path.display().to_string())?;
        let scale: Value = serde_json::from_slice(&text).map_err(|error| anyhow!("{}: {error}", path.display()))?;
        match scale["delta_max"].as_f64() {
            Some(delta_max) if delta_max > 0.0 => Ok(Some(Self { folder, delta_max })),
            _ => bail!("{}: \"delta_max\" is {}; expected a number above 0", path.display(), scale["delta_max"]),
        }
    }

    /// The folder that holds it.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Compares a photo's depth with the truth, if the photo has one.
    pub(super) fn score(&self, view: &View, depth: &ViewDepth) -> Result<Option<Score>> {
        let path = self.folder.join(stem(&view.name) + ".png");
        if !path.is_file() {
            return Ok(None);
        }
        let picture = image::load(&path)?;
        let (actual, expected) = (picture.size(), view.camera.size());
        if actual != expected {
            bail!("{}: {actual}; expected {expected}, the size of the photo", path.display());
        }
        let truth = |(y, x)| (f64::from(picture.pixel(x, y)[0]) * self.delta_max) as f32;
        Ok(Some(score(depth, &Array2::from_shape_fn(depth.found.disparity.dim(), truth))))
    }
}

fn score(depth: &ViewDepth, truth: &Array2<f32>) -> Score {
    // The pixels within each bound, then all pixels.
    let (mut known, mut confirmed) = ([0_usize; 4], [0_usize; 4]);
    for ((found, confirmed_disparity), &truth) in
        depth.found.disparity.iter().zip(&depth.confirmed.disparity).zip(truth)
    {
        if truth > 0.0 {
            let error = (found - truth).abs() / depth.found.disparity_per_pixel;
            let count = |counts: &mut [usize; 4]| {
                counts[3] += 1;
                WITHIN.iter().zip(counts).for_each(|(&bound, count)| *count += usize::from(error <= bound));
            };
            count(&mut known);
            if *confirmed_disparity >= 0.0 {
                count(&mut confirmed);
            }
        }
    }
    let shares = |counts: [usize; 4]| std::array::from_fn(|k| counts[k] as f64 / counts[3].max(1) as f64);
    Score { confirmed: shares(confirmed), all: shares(known) }
}
