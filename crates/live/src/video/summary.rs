//! The report of `liveview video`, as text and as JSON.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use crate::session::Policy;
use liveview_synthesizer::LayerSpec;
use liveview_synthesizer::Score;
use serde_json::{Value, json};

use super::gather::Faults;
use super::sink::Written;
use super::tally::Tally;
use super::viewpoint::Viewpoint;
use crate::governor::Level;
use crate::rig::Rig;

const BORDER: usize = Score::BORDER;

/// The results of a video.
pub(super) struct VideoResults {
    pub(super) tally: Tally,
    pub(super) written: Written,
    pub(super) faults: Faults,
    /// Each step from which on another level was used, with the level.
    pub(super) changes: Vec<(usize, Level)>,
    pub(super) wall: Duration,
    pub(super) stopped: bool,
    /// Whether an interrupt ended it before the last frame.
    pub(super) interrupted: bool,
}

/// The report without the network.
pub(super) fn summary(
    rig: &Rig,
    viewpoint: &Viewpoint,
    results: &VideoResults,
    file: Option<&Path>,
    (layers, policy): (&LayerSpec, Policy),
) -> (String, Value) {
    let VideoResults { tally, written, faults, changes, wall, stopped, .. } = results;
    let scene = rig.views.scene();
    let mut text = String::new();
    let mut line = |label: &str, content: String| {
        let _ = writeln!(text, "{label:8} {content}");
    };
    let held_out = viewpoint.truth.map(|view| format!(", {} held out", scene.views[view].name)).unwrap_or_default();
    line("rig", format!("{}: {} cameras{held_out}, {}", scene.root.display(), rig.feeds.len(), scene.format));
    line("layers", format!("{layers}, {policy}"));
    let end = if *stopped { "; stopped early" } else { "" };
    line(
        "frames",
        format!(
            "{} in, {} rendered, {} repeated, of these {} dropped as too late{end}",
            tally.rendered + tally.repeated,
            tally.rendered,
            tally.repeated,
            tally.dropped
        ),
    );
    line("search", tally.layer_sources());
    if let Some((psnr, ssim, flicker)) = tally.scores() {
        let flicker = flicker.map(|flicker| format!(", flicker {:.3} of 255", 255.0 * flicker)).unwrap_or_default();
        line("score", format!("PSNR {psnr:.2} dB, SSIM {ssim:.4}{flicker} ({BORDER}-pixel border excluded)"));
    }
    let seconds = tally.seconds();
    let total: f64 = seconds.iter().sum();
    let shares = tally.stages.iter().zip(seconds);
    let shares: Vec<String> =
        shares.map(|(stage, spent)| format!("{stage} {:.1} ({:.0} %)", 1e3 * spent, 100.0 * spent / total)).collect();
    let writing = 1e3 * written.encoding.as_secs_f64() / written.frames.max(1) as f64;
    line(
        "times",
        format!("{:.1} ms per frame: {}; writing, in parallel: {writing:.1}", 1e3 * total, shares.join(", ")),
    );
    line("speed", format!("{:.1} frames per second", written.frames as f64 / wall.as_secs_f64()));
    let percentiles = (written.latencies.percentile(0.5), written.latencies.percentile(0.99));
    if let (Some(median), Some(most)) = percentiles {
        line("latency", format!("median {median} ms, 99 % {most} ms"));
    }
    for (step, level) in changes {
        line("level", format!("from frame {step}: {} at {:.0} % of the size", level.layers, 100.0 * level.scale));
    }
    if tally.logits_not_finite > 0 {
        line("network", format!("{} of its logits over all frames are NaN or infinite", tally.logits_not_finite));
    }
    let mut cameras = Vec::new();
    for (feed, (count, first)) in rig.feeds.iter().zip(&faults.cameras) {
        if let Some(first) = first {
            let missing = match count {
                0 => String::new(),
                1 => "1 frame not delivered: ".to_owned(),
                count => format!("{count} frames not delivered; the first: "),
            };
            line("camera", format!("{}: {missing}{first}", feed.name));
            cameras.push(json!({ "camera": feed.name, "not_delivered": count, "first": first }));
        }
    }
    if let Some(file) = file {
        line("wrote", file.display().to_string());
    }
    let mut json = tally.json();
    let more = json!({
        "rig": scene.root.display().to_string(), "format": scene.format.to_string(), "cameras": rig.views.names(&(0..rig.feeds.len()).collect::<Vec<_>>()),
        "held_out": viewpoint.truth.map(|view| &scene.views[view].name), "layers": layers.to_string(), "policy": policy.to_string(), "frames": written.frames,
        "writing_seconds_per_frame": writing / 1e3, "seconds": wall.as_secs_f64(), "excluded_border": BORDER,
        "latency_ms": { "median": percentiles.0, "percentile_99": percentiles.1 }, "changes": changes_json(changes),
        "logits_not_finite": tally.logits_not_finite, "faults": cameras, "stopped": stopped, "file": file.map(|file| file.display().to_string()), "notes": scene.notes,
    });
    if let (Value::Object(json), Value::Object(more)) = (&mut json, more) {
        json.extend(more);
    }
    (text, json)
}

/// The level changes as JSON.
fn changes_json(changes: &[(usize, Level)]) -> Value {
    let change = |(step, level): &(usize, Level)| {
        let mut json = level.json();
        json["from_frame"] = json!(step);
        json
    };
    changes.iter().map(change).collect()
}
