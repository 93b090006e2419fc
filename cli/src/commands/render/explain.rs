//! `render --explain`: the layers that were used and skipped, and the time of each stage.

use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use liveview::layers::{CELL, Layer};
use liveview::network::Alpha;
use liveview::render::ViewCorrection;
use liveview::{Frame, ImageRgb};
use liveview_scene::save_picture;
use liveview_surface::guided::RangeMap;
use liveview_synthesizer::colormap::{coloured, side_by_side};
use liveview_synthesizer::{Plan, Shot, TargetSurface};
use ndarray::{Array2, Axis, s};
use serde_json::{Value, json};

use crate::console::{Output, path_text};
use crate::job::{Job, Times};

/// The colour of guessed pixels.
const PINK: [f32; 3] = [1.0, 0.0, 0.6];

/// The render to explain.
pub(super) struct Explained<'a> {
    pub(super) shot: &'a Shot,
    pub(super) plan: &'a Plan,
    pub(super) frame: &'a Frame,
    pub(super) times: &'a Times,
}

/// Explains a render, as text, as JSON and in a picture.
pub(super) fn explain(file: &Path, job: &Job, about: &Explained<'_>) -> Result<Output> {
    let mut text = String::new();
    let mut json = json!({ "file": path_text(file) });
    let picture = match (&about.plan.range, &about.plan.surface) {
        (Some(range), _) => guided(about, range, &mut text),
        (None, Some(target_surface)) => surface(about, target_surface, &mut text, &mut json),
        (None, None) => planes(about, job.synthesizer.renderer().alpha(), &mut text, &mut json),
    };
    corrections(&about.plan.corrections, &mut text, &mut json);
    uncovered(about.frame, &mut text, &mut json);
    time_shares(about.times, &mut text, &mut json);
    save_picture(&picture, file)?;
    Ok(Output { text, json })
}

/// Nearest and farthest disparity of each pixel's range, side by side.
fn guided(about: &Explained<'_>, range: &RangeMap, text: &mut String) -> ImageRgb {
    let _ = writeln!(text, "layers  {} within each pixel's own depth range", about.plan.layers.len());
    let Shot { near, far, target, .. } = about.shot;
    let size = (target.height(), target.width());
    let full = |map: &Array2<f32>| Array2::from_shape_fn(size, |(y, x)| map[(y / CELL, x / CELL)]);
    let picture = |map| coloured(full(map).view(), (1.0 / far) as f32, (1.0 / near) as f32);
    side_by_side(&[&picture(&range.nearest), &picture(&range.farthest)])
}

/// The picture with its guessed pixels marked, beside the surface.
fn surface(about: &Explained<'_>, target_surface: &TargetSurface, text: &mut String, json: &mut Value) -> ImageRgb {
    let guessed = target_surface.surface.guessed_share();
    let occluded = about.frame.occluded_pixels as f64 / about.frame.transmittance.len() as f64;
    let _ = writeln!(
        text,
        "surface {} layers along it; {:.1} % of it guessed (pink), {:.1} % occluded in every view",
        about.plan.layers.len(),
        100.0 * guessed,
        100.0 * occluded
    );
    json["surface"] = json!({ "guessed_share": guessed, "occluded_share": occluded });
    let Shot { near, far, target, .. } = about.shot;
    let part = s![..target.height(), ..target.width()];
    let disparity = coloured(target_surface.surface.disparity.slice(part), (1.0 / far) as f32, (1.0 / near) as f32);
    let mut picture = about.frame.picture().as_array().to_owned();
    for (mut pixel, &guessed) in picture.lanes_mut(Axis(2)).into_iter().zip(target_surface.surface.guessed.slice(part))
    {
        if guessed {
            pixel.iter_mut().zip(PINK).for_each(|(value, pink)| *value = 0.5 * (*value + pink));
        }
    }
    side_by_side(&[&ImageRgb::from_array(picture.view()).expect("three channels"), &disparity])
}

/// Exposure gains and sharpening of the views, in their order.
fn corrections(corrections: &[ViewCorrection], text: &mut String, json: &mut Value) {
    if corrections.is_empty() {
        return;
    }
    let gains: Vec<_> = corrections.iter().map(|view| view.gains).collect();
    let sharpening: Vec<_> = corrections.iter().map(|view| view.sharpening).collect();
    let max_change = gains.iter().flatten().fold(0.0, |max: f32, gain| max.max((gain - 1.0).abs()));
    let _ = writeln!(text, "gains   the exposure of the photos is changed by up to {:.1} %", 100.0 * max_change);
    let max_sharpening = sharpening.iter().copied().fold(0.0, f32::max);
    if max_sharpening >= 0.005 {
        let _ = writeln!(text, "        and softer photos are sharpened by up to {:.1} %", 100.0 * max_sharpening);
    }
    json["gains"] = json!(gains);
    json["sharpening"] = json!(sharpening);
}

/// The number of planes that most pixels need.
fn planes(about: &Explained<'_>, alpha: Alpha, text: &mut String, json: &mut Value) -> ImageRgb {
    let mut votes = vec![0usize; about.plan.layers.len()];
    about.frame.best_layer.iter().flatten().for_each(|&layer| votes[layer as usize] += 1);
    votes.sort_unstable_by(|a, b| b.cmp(a));
    let pixels: usize = votes.iter().sum();
    let sums = votes.iter().scan(0, |sum, &count| {
        *sum += count;
        Some(*sum)
    });
    let best = if alpha.is_independent() { "are the most opaque one" } else { "have the largest weight" };
    let needed = 1 + sums.take_while(|sum| 10 * sum < 9 * pixels).count();
    let layers = about.plan.layers.as_slice();
    let disparity = |layer: usize| if let Layer::Plane(disparity) = layers[layer] { disparity } else { f64::NAN };
    let [near, far] = [0, layers.len() - 1].map(|layer| 1.0 / disparity(layer));
    let _ = writeln!(
        text,
        "layers  {} planes from {near:.4} to {far:.4}, of which {needed} {best} for 90 % of the pixels: consider --layers \
         select:{needed}",
        layers.len()
    );
    json["planes_for_90_percent"] = json!(needed);
    json["planes_depth"] = json!([near, far]);
    let map: Array2<f32> =
        about.frame.best_layer.mapv(|best| best.map_or(f32::NAN, |layer| disparity(layer as usize) as f32));
    coloured(map.view(), (1.0 / about.shot.far) as f32, (1.0 / about.shot.near) as f32)
}

/// Layers that were skipped.
fn uncovered(frame: &Frame, text: &mut String, json: &mut Value) {
    if frame.uncovered_layers > 0 {
        let _ = writeln!(text, "skipped {} layers that no view covers", frame.uncovered_layers);
    }
    json["uncovered_layers"] = json!(frame.uncovered_layers);
}

/// Each stage's share of the time.
fn time_shares(times: &Times, text: &mut String, json: &mut Value) {
    let total = times.total().as_secs_f64();
    let shares = times.stages().map(|(stage, time)| (stage, time.as_secs_f64() / total)).into_iter();
    let shares: Vec<_> = shares.filter(|&(_, share)| share > 0.0).collect();
    let list: Vec<String> = shares.iter().map(|(stage, share)| format!("{stage} {:.0} %", 100.0 * share)).collect();
    let _ = writeln!(text, "shares  {} of {:.0} ms", list.join(", "), 1e3 * total);
    json["time_shares"] = shares.into_iter().map(|(stage, share)| (stage.to_owned(), json!(share))).collect();
}
