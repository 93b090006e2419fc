//! The output files of a photo's depth.

use std::path::{Path, PathBuf};

use crate::args::output::{has_extension, refuse_stdout, stem, write_atomically};
use crate::outputs::OutputPlan;
use anyhow::{Context, Result, bail};
use liveview::image::{coloured, encode, encode_gray16_png};
use liveview::{Scene, ViewDepth};
use ndarray_npy::WriteNpyExt;
use serde_json::json;

use super::truth::Truth;

/// Suffixes to the view's name: 16-bit PNG, its scale, float32 array, colour picture.
const SUFFIXES: [&str; 4] = [".png", "_scale.json", ".npy", "_colour.png"];

/// The files of each view, in a folder that is created; an error, before any work, if one cannot be
/// written.
pub(super) fn planned(
    folder: &Path,
    cache: Option<&Path>,
    scene: &Scene,
    views: &[usize],
    truth: Option<&Truth>,
) -> Result<Vec<[PathBuf; 4]>> {
    refuse_stdout("-o", folder)?;
    let shown = folder.display();
    if has_extension(folder, &["png", "npy", "npz", "json"]) && !folder.is_dir() {
        bail!("-o {shown}: expected a folder");
    }
    let same = |other: &Path| folder.canonicalize().is_ok_and(|folder| other.canonicalize().is_ok_and(|o| o == folder));
    if truth.is_some_and(|truth| same(truth.folder())) {
        bail!("-o {shown}: would overwrite the true depth of the scene; expected another folder");
    }
    let mut output_plan = OutputPlan::new(scene);
    output_plan.folder("-o", folder)?;
    cache.map_or(Ok(()), |folder| output_plan.cache("--cache", folder))?;
    let mut all = Vec::with_capacity(views.len());
    for &view in views {
        let name = &scene.views[view].name;
        let files = SUFFIXES.map(|suffix| folder.join(stem(name) + suffix));
        files
            .iter()
            .try_for_each(|file| output_plan.named_file("-o", file))
            .with_context(|| format!("the depth of {name}"))?;
        all.push(files);
    }
    output_plan.prepare()?;
    Ok(all)
}

pub(super) fn write(files: &[PathBuf; 4], depth: &ViewDepth) -> Result<()> {
    let known = &depth.confirmed.disparity;
    let (height, width) = known.dim();
    let (low, high) = ((1.0 / depth.range.1) as f32, (1.0 / depth.range.0) as f32);
    // The search extends half a plane beyond near.
    let largest = known.iter().copied().fold(high, f32::max);
    // At least 1 if confirmed, also at infinity: 0 means unconfirmed.
    let value = |&disparity: &f32| {
        if disparity < 0.0 { 0 } else { ((f64::from(disparity) / f64::from(largest) * 65535.0).round() as u16).max(1) }
    };
    let scale = json!({
        "liveview": env!("CARGO_PKG_VERSION"),
        "disparity": "value / 65535 * disparity_max = 1 / z, z along the camera's axis; 0: no other photo confirms it",
        "disparity_max": largest, "unit": "1/scene unit", "disparity_per_pixel_of_parallax": depth.found.disparity_per_pixel,
    });
    let mut array = Vec::new();
    known.write_npy(&mut array)?;
    let colour = known.mapv(|disparity| if disparity < 0.0 { f32::NAN } else { disparity });
    let contents = [
        encode_gray16_png(width, height, &known.iter().map(value).collect::<Vec<_>>())?,
        format!("{scale:#}\n").into_bytes(),
        array,
        encode("colour.png".as_ref(), &coloured(colour.view(), low, high))?,
    ];
    files.iter().zip(contents).try_for_each(|(file, contents)| write_atomically(file, &contents))
}
