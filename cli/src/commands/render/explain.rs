//! `render --explain`: what was left out and why, where the time went, and what it cost in quality.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use liveview::image::{Score, coloured, psnr};
use liveview::layers::guided::RangeMap;
use liveview::layers::{Layer, Layers};
use liveview::network::Alpha;
use liveview::{Frame, ImageRgb, LoadedShot, Plan, Shot, TargetSurface};
use liveview_common::args::numbers;
use liveview_common::args::output::expect_png;
use liveview_common::console::shown;
use liveview_common::job::Job;
use liveview_common::measure::Times;
use liveview_common::outputs::OutputPlan;
use liveview_common::statistics::{PixelError, percentile};
use ndarray::{Array2, s};
use serde_json::{Value, json};

use crate::commands::select::{range_picture, width_in_pixels};

/// Options that ask for reasons.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reasons")]
pub(super) struct ExplainArgs {
    /// Say what was left out and why, and where the time went; and draw guided layers' nearest and farthest disparity and the width
    /// between them, or each pixel's plane. For one target
    #[arg(long, value_name = "PNG")]
    explain: Option<PathBuf>,
    /// Render D uniform planes too, and say how far the result is from them
    #[arg(long, value_name = "D", value_parser = numbers::count, requires = "explain", conflicts_with = "network")]
    dense: Option<usize>,
}

/// A render that is to be explained.
pub(super) struct Explained<'a> {
    pub(super) shot: &'a Shot,
    pub(super) loaded: &'a LoadedShot,
    pub(super) plan: &'a Plan,
    pub(super) frame: &'a Frame,
    pub(super) times: &'a Times,
    pub(super) truth: Option<&'a ImageRgb>,
}

/// The explanation, as text and as JSON.
pub(super) struct Explanation {
    pub(super) text: String,
    pub(super) json: Value,
}

impl ExplainArgs {
    /// Checks the options before any work.
    pub(super) fn plan_outputs(&self, shots: &[Shot], output_plan: &mut OutputPlan) -> Result<()> {
        let Some(file) = &self.explain else { return Ok(()) };
        if shots.len() != 1 {
            bail!("--explain {}: {} pictures are rendered; expected one target", file.display(), shots.len());
        }
        expect_png("--explain", file)?;
        output_plan.file("--explain", file)
    }

    /// Explains a render, if asked to.
    pub(super) fn explain(&self, job: &mut Job, about: &Explained<'_>) -> Result<Option<Explanation>> {
        let Some(file) = &self.explain else { return Ok(None) };
        let mut text = String::new();
        let mut json = json!({ "file": shown(file) });
        let picture = match (&about.plan.range, &about.plan.surface) {
            (Some(range), _) => guided(job, about, range, &mut text, &mut json),
            (None, Some(seen)) => surface(about, seen, &mut text, &mut json),
            (None, None) => planes(about, job.alpha(), &mut text, &mut json),
        };
        uncovered(about.frame, &mut text, &mut json);
        time_shares(about.times, &mut text, &mut json);
        if let Some(planes) = self.dense {
            dense(job, about, planes, &mut text, &mut json)?;
        }
        picture.save(file)?;
        Ok(Some(Explanation { text, json }))
    }
}

/// Each pixel's range, and how many uniform planes would be spaced as closely.
fn guided(job: &Job, about: &Explained<'_>, range: &RangeMap, text: &mut String, json: &mut Value) -> ImageRgb {
    let whole = 1.0 / about.shot.near - 1.0 / about.shot.far;
    let spans = range.nearest() - range.farthest();
    let mut shares: Vec<f64> = spans.iter().map(|&span| f64::from(span) / whole).collect();
    let [median, wide] = [0.5, 0.95].map(|part| percentile(&mut shares, part));
    let width = width_in_pixels(job.views(), about.shot, range);
    let mut steps: Vec<f64> = width.iter().map(|&w| f64::from(w)).collect();
    let pixels = percentile(&mut steps, 0.5);
    let layers = about.plan.layers.len();
    let as_close = ((layers.saturating_sub(1)) as f64 / median).ceil().max(1.0) + 1.0;
    let _ = writeln!(
        text,
        "layers  {layers}, each pixel's own: half of the pixels need only {:.1} % of the depth range ({pixels:.1} pixels of \
         parallax), 95 in 100 of them {:.1} %",
        100.0 * median,
        100.0 * wide
    );
    if layers > 1 {
        let _ = writeln!(text, "planes  {as_close:.0} uniform planes would be as close together");
    }
    json["range_share"] = json!({ "median": median, "95 %": wide });
    json["range_pixels_median"] = json!(pixels);
    json["uniform_planes_as_close"] = json!((layers > 1).then_some(as_close));
    range_picture(about.shot, range, &width)
}

/// The surface, how much of it no photo's depth gives, and what exposure was balanced by.
fn surface(about: &Explained<'_>, seen: &TargetSurface, text: &mut String, json: &mut Value) -> ImageRgb {
    let holes = seen.surface().holes;
    let hidden = about.frame.occluded_pixels as f64 / about.frame.transmittance.len() as f64;
    let _ = writeln!(
        text,
        "surface {} layers along it; {:.1} % of it beside what the photos' depth gives, {:.1} % hidden from all views",
        about.plan.layers.len(),
        100.0 * holes,
        100.0 * hidden
    );
    let apart = seen.gains().iter().flatten().fold(0.0, |most: f32, gain| most.max((gain - 1.0).abs()));
    let _ =
        writeln!(text, "gains   photos are made up to {:.1} % brighter or darker to agree in exposure", 100.0 * apart);
    let most = seen.sharpening().iter().copied().fold(0.0, f32::max);
    if most >= 0.005 {
        let _ = writeln!(
            text,
            "        and sharpened by up to {:.1} % of their detail, as they show each other",
            100.0 * most
        );
    }
    let (gains, sharpening) = (seen.gains(), seen.sharpening());
    json["surface"] =
        json!({ "holes": holes, "hidden_from_all_views": hidden, "gains": gains, "sharpening": sharpening });
    let Shot { near, far, target, .. } = about.shot;
    let part = s![..target.height(), ..target.width()];
    coloured(seen.surface().disparity.slice(part), (1.0 / far) as f32, (1.0 / near) as f32)
}

/// Which planes are the pixels' best ones.
fn planes(about: &Explained<'_>, alpha: Alpha, text: &mut String, json: &mut Value) -> ImageRgb {
    let mut votes = vec![0usize; about.plan.layers.len()];
    about.frame.best_layer.iter().flatten().for_each(|&layer| votes[layer as usize] += 1);
    votes.sort_unstable_by(|a, b| b.cmp(a));
    let chosen: usize = votes.iter().sum();
    let sums = votes.iter().scan(0, |sum, &count| {
        *sum += count;
        Some(*sum)
    });
    let best = if alpha.is_independent() { "are the most opaque one" } else { "have the largest weight" };
    let needed = 1 + sums.take_while(|sum| 10 * sum < 9 * chosen).count();
    let _ = writeln!(
        text,
        "layers  {} planes, of which {needed} {best} for 90 % of the pixels: the others could be left out (--layers select:K)",
        about.plan.layers.len()
    );
    json["planes_for_90_percent"] = json!(needed);
    let disparity = |layer: Option<u32>| match layer.map(|layer| &about.plan.layers.as_slice()[layer as usize]) {
        Some(&Layer::Plane(disparity)) => disparity as f32,
        _ => f32::NAN,
    };
    let map: Array2<f32> = about.frame.best_layer.mapv(disparity);
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
    let all = times.total().as_secs_f64();
    let shares = times.stages().map(|(stage, time)| (stage, time.as_secs_f64() / all)).into_iter();
    let shares: Vec<_> = shares.filter(|&(_, share)| share > 0.0).collect();
    let list: Vec<String> = shares.iter().map(|(stage, share)| format!("{stage} {:.0} %", 100.0 * share)).collect();
    let _ = writeln!(text, "shares  {} of {:.0} ms", list.join(", "), 1e3 * all);
    json["time_shares"] = shares.into_iter().map(|(stage, share)| (stage.to_owned(), json!(share))).collect();
}

/// How far the result is from that on `planes` uniform planes.
fn dense(job: &mut Job, about: &Explained<'_>, planes: usize, text: &mut String, json: &mut Value) -> Result<()> {
    let layers = Layers::uniform(about.shot.near, about.shot.far, planes)?;
    let dense = job.render(about.loaded, &Plan::known(layers))?;
    let PixelError { max, mean } = PixelError::between(std::iter::once((&about.frame.picture, &dense.picture)));
    let seconds = (dense.times.warp + dense.times.network + dense.times.composite).as_secs_f64();
    let faster = seconds / about.times.total().as_secs_f64();
    let _ = writeln!(
        text,
        "dense   {planes} planes: {mean:.4} away in the mean, {max:.2} at most (of 1); they take {faster:.1} times as long"
    );
    json["dense"] = json!({ "planes": planes, "error_max": max, "error_mean": mean, "seconds": seconds });
    if let Some(truth) = about.truth {
        let [own, of_planes] =
            [&about.frame.picture, &dense.picture].map(|picture| psnr(picture, truth, Score::BORDER));
        let _ = writeln!(text, "        against the photo: {own:.2} dB, the {planes} planes {of_planes:.2} dB");
        json["dense"]["psnr"] = json!(of_planes);
    }
    Ok(())
}
