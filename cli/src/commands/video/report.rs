//! The report of `liveview video`. Totals are kept in constant memory: numbers of frames, their times and scores (PSNR, SSIM and
//! flicker) against those of the held-out camera. The figures of each frame go to the log.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use liveview::ImageRgb;
use liveview_files::atomic::AtomicFile;
use liveview_synthesizer::{LayerSpec, Score};
use serde_json::{Value, json};

use super::Viewpoint;
use super::gather::{Faults, Step};
use super::governor::Level;
use super::player::Written;
use liveview_live::resident_memory;
use liveview_live::rig::{Rig, SourceCounts};
use liveview_live::session::{LayerSource, LiveFrame, LiveTimes, Policy};

/// Histogram of durations in milliseconds, up to ten seconds.
pub(super) struct Latencies(Vec<u64>);

impl Latencies {
    pub(super) fn new() -> Self {
        Self(vec![0; 10_001])
    }

    pub(super) fn add(&mut self, latency: Duration) {
        let last = self.0.len() - 1;
        self.0[(latency.as_millis() as usize).min(last)] += 1;
    }

    /// Milliseconds that a share (0 to 1) of them does not exceed; `None` if there are none.
    pub(super) fn percentile(&self, share: f64) -> Option<usize> {
        let total: u64 = self.0.iter().sum();
        let wanted = (share * total as f64).ceil().max(1.0) as u64;
        let mut below = 0;
        self.0.iter().position(|&count| {
            below += count;
            below >= wanted
        })
    }
}

/// Sums over the frames.
#[derive(Default)]
pub(super) struct Tally {
    pub(super) rendered: usize,
    pub(super) repeated: usize,
    /// Why the first frame was repeated.
    pub(super) why_repeated: Option<String>,
    pub(super) dropped: usize,
    /// Whether any camera covers any pixel of any frame.
    pub(super) covered: bool,
    /// NaN and infinite logits of the network, over all frames.
    pub(super) logits_not_finite: usize,
    /// Names of the stages of a frame, in order.
    pub(super) stages: [&'static str; 5],
    layer_sources: BTreeMap<String, usize>,
    refreshed: f64,
    waited: Duration,
    /// Frames since the last search: the sum and the most.
    age: (usize, usize),
    spent: [Duration; 5],
    /// PSNR, SSIM and flicker: sums and counts.
    scores: [(f64, usize); 3],
    log: Option<Log>,
}

struct Log {
    path: PathBuf,
    file: AtomicFile,
}

impl Tally {
    /// Empty totals; with a log file, if one is given. `weighting`: the name of the stage that computes opacities and view weights.
    pub(super) fn new(log: Option<&Path>, weighting: &'static str) -> Result<Self> {
        let open = |path: &Path| {
            let file =
                AtomicFile::create(path).with_context(|| format!("--log {}: cannot be written", path.display()))?;
            Ok::<_, anyhow::Error>(Log { path: path.to_owned(), file })
        };
        let stages = ["photos", "layers", "warp", weighting, "composite"];
        Ok(Self { stages, log: log.map(open).transpose()?, ..Self::default() })
    }

    pub(super) fn add(&mut self, step: &Step, frame: &LiveFrame, scores: Option<Scores>) -> Result<()> {
        self.rendered += 1;
        self.waited += step.waited;
        self.age = (self.age.0 + frame.age, self.age.1.max(frame.age));
        self.logits_not_finite += frame.frame.logits_not_finite;
        self.covered = self.covered || frame.frame.transmittance.iter().any(|&left| left < 1.0 - 1e-6);
        *self.layer_sources.entry(frame.layer_source.to_string()).or_default() += 1;
        let refreshed = if let LayerSource::Propagated { refreshed } = frame.layer_source { refreshed } else { 0.0 };
        self.refreshed += refreshed;
        let LiveTimes { photos, layers, stages, .. } = &frame.times;
        // In the order of `Tally::stages`.
        let spent = [*photos, *layers, stages.warp, stages.network, stages.composite];
        self.spent.iter_mut().zip(spent).for_each(|(sum, spent)| *sum += spent);
        if let Some(Scores { score, flicker }) = scores {
            for (sum, score) in self.scores.iter_mut().zip([Some(score.psnr), Some(score.ssim), flicker]) {
                if let Some(score) = score {
                    *sum = (sum.0 + score, sum.1 + 1);
                }
            }
        }
        let arrived = frame.views.iter().filter_map(|&view| Some(step.photos[view].as_ref()?.1));
        self.line(json!({
            "since_arrival": arrived.min().map(|first| first.elapsed().as_secs_f64()), "frame": step.index, "waited": step.waited.as_secs_f64(), "age": frame.age, "layers_from": frame.layer_source.to_string(), "refreshed": refreshed, "views": frame.views, "seconds": self.by_stage(spent.map(|spent| spent.as_secs_f64())),
            "psnr": scores.map(|s| s.score.psnr), "ssim": scores.map(|s| s.score.ssim), "flicker": scores.and_then(|s| s.flicker),
        }))
    }

    pub(super) fn repeat(&mut self, step: usize, why: &str) -> Result<()> {
        self.repeated += 1;
        self.why_repeated.get_or_insert_with(|| why.to_owned());
        self.line(json!({ "frame": step, "layers_from": "repeated", "why": why }))
    }

    fn line(&mut self, mut line: Value) -> Result<()> {
        let Some(log) = &mut self.log else { return Ok(()) };
        line["memory_bytes"] = json!(resident_memory());
        writeln!(log.file, "{line}").with_context(|| format!("--log {}", log.path.display()))
    }

    /// Closes the log.
    pub(super) fn finish(&mut self) -> Result<()> {
        let Some(log) = self.log.take() else { return Ok(()) };
        log.file.finish().with_context(|| format!("--log {}: cannot be written", log.path.display()))
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

    /// Seconds of each stage by its name, as JSON.
    fn by_stage(&self, seconds: [f64; 5]) -> Value {
        self.stages.iter().zip(seconds).map(|(stage, seconds)| ((*stage).to_owned(), json!(seconds))).collect()
    }

    /// Numbers of frames by the source of their layers, as text.
    pub(super) fn layer_sources(&self) -> String {
        let counts = self.layer_sources.iter().map(|(source, frames)| format!("{source} {frames}"));
        let counts = counts.collect::<Vec<_>>().join(", ");
        let share = self.refreshed / self.rendered.max(1) as f64;
        if share > 0.0 { counts + &format!("; {:.1} % of a frame refreshed on average", 100.0 * share) } else { counts }
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "rendered": self.rendered, "repeated": self.repeated, "dropped": self.dropped, "layers_from": self.layer_sources,
            "refreshed_share": self.refreshed / self.rendered.max(1) as f64, "seconds_per_frame": self.by_stage(self.seconds()),
            "mean": { "psnr": self.mean(0), "ssim": self.mean(1), "flicker": self.mean(2) },
        })
    }
}

/// The scores of a frame against its ground truth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scores {
    pub(super) score: Score,
    /// Mean |change of the picture − change of the ground truth| since the previous frame, of values in [0, 1].
    pub(super) flicker: Option<f64>,
}

/// Scores the frames of a video.
#[derive(Default)]
pub(super) struct Scorer {
    /// The previous picture and its ground truth.
    previous: Option<(ImageRgb, ImageRgb)>,
}

impl Scorer {
    pub(super) fn score(&mut self, picture: &ImageRgb, truth: ImageRgb) -> Option<Scores> {
        let Some(score) = Score::of(picture, &truth) else {
            self.previous = None; // too small to be scored
            return None;
        };
        let previous = self.previous.as_ref();
        let flicker = previous.map(|(before, truth_before)| flicker([before, picture], [truth_before, &truth]));
        self.previous = Some((picture.clone(), truth));
        Some(Scores { score, flicker })
    }

    /// Starts again after a gap: the next frame has no flicker.
    pub(super) fn restart(&mut self) {
        self.previous = None;
    }
}

fn flicker(pictures: [&ImageRgb; 2], truths: [&ImageRgb; 2]) -> f64 {
    let (width, height) = (truths[1].width(), truths[1].height());
    let (mut sum, mut count) = (0.0, 0.0);
    for y in Score::BORDER..height.saturating_sub(Score::BORDER) {
        let row = 3 * (y * width + Score::BORDER)..3 * ((y + 1) * width - Score::BORDER);
        let [before, now, truth_before, truth] =
            [pictures[0], pictures[1], truths[0], truths[1]].map(|picture| &picture.data()[row.clone()]);
        for i in 0..before.len() {
            sum += f64::from(((now[i] - before[i]) - (truth[i] - truth_before[i])).abs());
            count += 1.0;
        }
    }
    sum / count
}

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
    let rendered = tally.rendered.max(1) as f64;
    let (waiting, age) = (1e3 * tally.waited.as_secs_f64() / rendered, tally.age.0 as f64 / rendered);
    let writing = 1e3 * written.encoding.as_secs_f64() / written.frames.max(1) as f64;
    line(
        "times",
        format!(
            "{:.1} ms per frame: {}; in parallel: waiting for cameras {waiting:.1}, writing {writing:.1}",
            1e3 * total,
            shares.join(", ")
        ),
    );
    line("speed", format!("{:.1} frames per second", written.frames as f64 / wall.as_secs_f64()));
    line("age", format!("{age:.1} frames since the layers were searched, on average, at most {}", tally.age.1));
    let percentiles = [0.5, 0.95, 0.99].map(|share| written.latencies.percentile(share));
    if let [Some(median), Some(high), Some(most)] = percentiles {
        line("latency", format!("median {median} ms, 95 % {high} ms, 99 % {most} ms"));
    }
    for (step, level) in changes {
        line("level", format!("from frame {step}: {level}"));
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
    let mut sources = Vec::new();
    for (feed, source) in rig.feeds.iter().filter_map(|feed| Some((feed, feed.source()?))) {
        let SourceCounts { frames, unused, missing, longest_gap, late, restarts, failure } = source.counts();
        let [gap, late] = [longest_gap, late.unwrap_or_default()].map(|time| time.as_millis());
        let why = failure.as_ref().map(|why| format!(": {why}")).unwrap_or_default();
        line(
            "source",
            format!(
                "{}: {frames} frames, {unused} not used, {missing} missing, at most {gap} ms apart, {late} ms late, started again {restarts} times{why}",
                feed.name
            ),
        );
        sources.push(json!({
            "camera": feed.name, "frames": frames, "not_used": unused, "missing": missing, "longest_gap_ms": gap, "late_ms": late, "restarts": restarts, "failure": failure,
        }));
    }
    if let Some(file) = file {
        line("wrote", file.display().to_string());
    }
    let change = |(step, level): &(usize, Level)| json!({ "from_frame": step, "layers": level.layers.to_string(), "coarse_depth": level.coarse_depth, "scale": level.scale });
    let mut json = tally.json();
    let more = json!({
        "rig": scene.root.display().to_string(), "format": scene.format.to_string(), "cameras": rig.views.names(&(0..rig.feeds.len()).collect::<Vec<_>>()),
        "held_out": viewpoint.truth.map(|view| &scene.views[view].name), "layers": layers.to_string(), "policy": policy.to_string(), "frames": written.frames,
        "writing_seconds_per_frame": writing / 1e3, "seconds": wall.as_secs_f64(), "excluded_border": BORDER,
        "latency_ms": { "median": percentiles[0], "percentile_95": percentiles[1], "percentile_99": percentiles[2] }, "sources": sources,
        "waiting_seconds_per_frame": waiting / 1e3, "age": { "mean": age, "most": tally.age.1 }, "changes": changes.iter().map(change).collect::<Vec<_>>(),
        "logits_not_finite": tally.logits_not_finite, "faults": cameras, "stopped": stopped, "file": file.map(|file| file.display().to_string()), "notes": scene.notes,
    });
    if let (Value::Object(json), Value::Object(more)) = (&mut json, more) {
        json.extend(more);
    }
    (text, json)
}

/// The report as a table.
pub(super) fn markdown(text: &str) -> String {
    let rows = text.lines().filter_map(|line| line.split_once(' '));
    let rows = rows.map(|(label, content)| format!("| {label} | {} |\n", content.trim().replace('|', "\\|")));
    format!("| | |\n|---|---|\n{}", rows.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_in_whole_milliseconds() {
        let mut latencies = Latencies::new();
        assert_eq!(latencies.percentile(0.5), None);
        (1..=100).for_each(|ms| latencies.add(Duration::from_millis(ms)));
        latencies.add(Duration::from_secs(60));
        assert_eq!(latencies.percentile(0.5), Some(51));
        assert_eq!((latencies.percentile(0.99), latencies.percentile(1.0)), (Some(100), Some(10_000)));
    }
}

#[cfg(test)]
mod scorer_tests {
    use super::*;

    #[test]
    fn frames_narrower_than_the_border_are_not_scored() {
        let frame = || ImageRgb::new(28, 60, vec![0.5; 3 * 28 * 60]).unwrap();
        let mut scorer = Scorer::default();
        assert!((0..2).all(|_| scorer.score(&frame(), frame()).is_none()));
    }

    #[test]
    fn flicker_is_the_change_that_the_truth_lacks() {
        let flat = |value: f32| ImageRgb::new(48, 48, vec![value; 3 * 48 * 48]).unwrap();
        let mut scorer = Scorer::default();
        assert!(scorer.score(&flat(0.5), flat(0.4)).unwrap().flicker.is_none());
        let steady = scorer.score(&flat(0.7), flat(0.6)).unwrap().flicker.unwrap();
        let flickers = scorer.score(&flat(0.6), flat(0.6)).unwrap().flicker.unwrap();
        assert!(steady < 1e-6 && (flickers - 0.1).abs() < 1e-6, "{steady} {flickers}");
    }
}
