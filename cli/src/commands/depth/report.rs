//! The report on the depth of the photos, as text and as JSON.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use liveview_live::memory::peak_memory;
use liveview_synthesizer::{DepthSource, Scene, ViewDepth};
use serde_json::{Value, json};

use super::truth::{Score, WITHIN};
use crate::console::{Output, path_text};
use crate::measure::time_text;

pub(super) fn output(scene: &Scene, reports: &[Report], (near, far): (f64, f64), held_out: &[usize]) -> Output {
    let scored = reports.iter().any(|one| one.score.is_some());
    let width = reports.iter().map(|one| one.name.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("photos: {}, searched from {near:.4} to {far:.4} scene units\n", reports.len());
    if scored {
        let bounds = WITHIN.map(|bound| format!("{bound}")).join(", ");
        let _ = writeln!(
            text,
            "shares of pixels within {bounds} pixels of parallax of the truth: of the confirmed | of all pixels"
        );
    }
    let truth = if scored { format!("  {:^20} | {:^20}", "confirmed", "all") } else { String::new() };
    let _ = writeln!(text, "\n{:width$}  confirmed     nearest    farthest          time{truth}", "photo");
    for Report { name, depth, score, .. } in reports {
        let span = match depth.span {
            Some((nearest, farthest)) => format!("{nearest:10.4}  {farthest:10.4}"),
            None => format!("{:>10}  {:>10}", "-", "-"),
        };
        let time = match depth.source {
            DepthSource::Kept => format!("{} kept", time_text(Duration::from_secs_f64(depth.seconds))),
            DepthSource::Alone => "alone".to_owned(),
            _ => time_text(Duration::from_secs_f64(depth.seconds)),
        };
        let score = score.as_ref().map(|score| format!("  {}", cells(score))).unwrap_or_default();
        let _ = writeln!(text, "{name:width$}  {:7.1} %  {span}  {time:>12}{score}", 100.0 * depth.confirmed);
    }
    let mean = mean(reports);
    if let (Some(mean), true) = (&mean, reports.len() > 1) {
        let confirmed = reports.iter().map(|one| one.depth.confirmed).sum::<f64>() / reports.len() as f64;
        let _ = writeln!(text, "{:width$}  {:7.1} %  {:36}  {}", "mean", 100.0 * confirmed, "", cells(mean));
    }
    if let [first, ..] = reports {
        let folder = first.files[0].parent().unwrap_or(Path::new(""));
        let _ = writeln!(text, "\nwrote {} files in {}", 4 * reports.len(), folder.display());
    }
    let json = json!({
        "scene": path_text(&scene.root), "near": near, "far": far,
        "held_out": held_out.iter().map(|&view| &scene.views[view].name).collect::<Vec<_>>(),
        "photos": reports.iter().map(photo).collect::<Vec<_>>(), "within_pixels": WITHIN, "mean": mean.as_ref().map(shares),
        "peak_memory_bytes": peak_memory(), "notes": scene.notes,
    });
    Output { text, json }
}

fn photo(report: &Report) -> Value {
    let Report { name, depth, score, files } = report;
    let source = match depth.source {
        DepthSource::Kept => "kept",
        DepthSource::Alone => "alone",
        _ => "searched",
    };
    json!({
        "name": name, "confirmed": depth.confirmed, "nearest": depth.span.map(|span| span.0), "farthest": depth.span.map(|span| span.1),
        "disparity_per_pixel_of_parallax": depth.disparity_per_pixel, "source": source, "seconds": depth.seconds,
        "within": score.as_ref().map(shares), "files": files.iter().map(|file| path_text(file)).collect::<Vec<_>>(),
    })
}

fn shares(score: &Score) -> Value {
    json!({ "confirmed": score.confirmed, "all": score.all })
}

fn cells(score: &Score) -> String {
    let [confirmed, all] =
        [score.confirmed, score.all].map(|shares| shares.map(|share| format!("{:4.1} %", 100.0 * share)).join(" "));
    format!("{confirmed:>20} | {all:>20}")
}

/// The mean of the photos that have a score.
fn mean(reports: &[Report]) -> Option<Score> {
    let scores: Vec<&Score> = reports.iter().filter_map(|one| one.score.as_ref()).collect();
    let mean = |of: fn(&Score) -> [f64; 3]| {
        std::array::from_fn(|k| scores.iter().map(|score| of(score)[k]).sum::<f64>() / scores.len() as f64)
    };
    (!scores.is_empty()).then(|| Score { confirmed: mean(|score| score.confirmed), all: mean(|score| score.all) })
}

/// The report on a photo's depth.
pub(super) struct Report {
    pub(super) name: String,
    pub(super) depth: ViewDepthSummary,
    pub(super) score: Option<Score>,
    pub(super) files: [PathBuf; 4],
}

/// A [`ViewDepth`] without its maps.
pub(super) struct ViewDepthSummary {
    pub(super) source: DepthSource,
    pub(super) seconds: f64,
    /// Share of the pixels that other photos confirm, 0 to 1.
    pub(super) confirmed: f64,
    /// Nearest and farthest confirmed depth, in scene units.
    pub(super) span: Option<(f64, f64)>,
    /// Disparity of one pixel of parallax, in 1/scene unit.
    pub(super) disparity_per_pixel: f32,
}

impl ViewDepthSummary {
    pub(super) fn of(depth: &ViewDepth) -> Self {
        let confirmed = || depth.confirmed.disparity.iter().copied().filter(|&disparity| disparity >= 0.0);
        let (low, high) =
            confirmed().fold((f32::INFINITY, 0.0_f32), |(low, high), value| (low.min(value), high.max(value)));
        let count = confirmed().count();
        Self {
            source: depth.source,
            seconds: depth.time.as_secs_f64(),
            confirmed: count as f64 / depth.confirmed.disparity.len() as f64,
            span: (count > 0).then(|| (1.0 / f64::from(high), 1.0 / f64::from(low))),
            disparity_per_pixel: depth.found.disparity_per_pixel,
        }
    }
}
