//! The rendered pictures, and the report on them: the summary of `render` as text and as JSON, and the table of scores as CSV.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Result, bail};
use liveview_live::peak_memory;
use liveview_synthesizer::{Score, Shot};
use serde_json::{Value, json};

use crate::args::has_extension;
use crate::console::{Output, counted, escaped, path_text};
use crate::job::{Job, Times, time_text};

/// Names listed in one line.
const LISTED_NAMES: usize = 6;

const BORDER: usize = Score::BORDER;

pub(super) fn rendered(
    job: &Job,
    done: &[Rendered],
    moving: bool,
    share: Option<(Range<usize>, usize)>,
    video: Option<PathBuf>,
    explanation: Option<Output>,
) -> Output {
    let mut text = pictures(job, done, moving);
    if let Some((frames, all)) = &share {
        line(&mut text, "frames", &format!("{} up to but without {}, of {all} of the path", frames.start, frames.end));
    }
    if let Some(video) = &video {
        line(&mut text, "wrote", &video.display().to_string());
    }
    if let Some(explanation) = &explanation {
        text += &explanation.text;
    }
    let memory = peak_memory();
    if let Some(bytes) = memory {
        line(&mut text, "memory", &format!("{:.0} MB at peak", bytes as f64 / 1e6));
    }
    text += &job.model.text();
    let mut json = json!({
        "scene": path_text(&job.synthesizer.scene().root), "format": job.synthesizer.scene().format.to_string(), "layers": job.synthesizer.layers().to_string(),
        "targets": done.iter().map(|one| target(job, one)).collect::<Vec<_>>(),
        "mean": mean(done).map(|(psnr, ssim)| json!({ "psnr": psnr, "ssim": ssim })),
        "excluded_border": BORDER, "peak_memory_bytes": memory, "video": video.as_deref().map(path_text), "notes": job.synthesizer.scene().notes,
        "frames": share.map(|(frames, all)| json!({ "start": frames.start, "end": frames.end, "of": all })),
        "explanation": explanation.map(|explanation| explanation.json),
    });
    if let (Value::Object(json), Value::Object(engine)) = (&mut json, job.model.json()) {
        json.extend(engine);
    }
    Output { text, json }
}

fn target(job: &Job, one: &Rendered) -> Value {
    let seconds = |times: &Times| times.stages().map(|(stage, time)| (stage.to_owned(), json!(time.as_secs_f64())));
    json!({
        "name": one.shot.name, "width": one.shot.target.width(), "height": one.shot.target.height(),
        "views": job.synthesizer.views().names(&one.shot.views), "near": one.shot.near, "far": one.shot.far, "layers": one.layers,
        "seconds": seconds(&one.times).into_iter().collect::<serde_json::Map<_, _>>(),
        "psnr": one.score.as_ref().map(|score| score.psnr), "ssim": one.score.as_ref().map(|score| score.ssim),
        "psnr_covered": one.psnr_covered, "uncovered_share": one.uncovered_share, "guessed_share": one.guessed_share, "occluded_share": one.occluded_share,
        "confirmed_share": one.confirmed_share, "agreeing_share": one.agreeing_share, "disparity_max": one.disparity_max,
        "files": one.files.iter().map(|file| path_text(file)).collect::<Vec<_>>(),
    })
}

/// The report on one picture, on the frames of a path, or on several pictures.
fn pictures(job: &Job, done: &[Rendered], moving: bool) -> String {
    let (what, of) = match done {
        [] => return String::new(),
        [one] => (escaped(&one.shot.name), ""),
        many if moving => (format!("{} frames", many.len()), " (medians per frame)"),
        many => (format!("{} pictures", many.len()), " (medians per picture)"),
    };
    let mut text = heading(job, done, &what);
    match done {
        [one] => line(&mut text, "views", &job.synthesizer.views().names(&one.shot.views).join(", ")),
        many if moving => {
            let views: BTreeSet<usize> = many.iter().flat_map(|one| one.shot.views.iter().copied()).collect();
            let views: Vec<usize> = views.into_iter().collect();
            line(&mut text, "views", &abbreviated(&job.synthesizer.views().names(&views)));
        }
        many => table(job, many, &mut text),
    }
    line_of_times(&mut text, done, of);
    if let [Rendered { score: Some(score), psnr_covered, .. }] = done {
        let covered = psnr_covered.map(|psnr| format!("; covered pixels alone: PSNR {psnr:.2} dB")).unwrap_or_default();
        let (psnr, ssim) = (score.psnr, score.ssim);
        line(
            &mut text,
            "score",
            &format!("PSNR {psnr:.2} dB, SSIM {ssim:.4} ({BORDER}-pixel border excluded){covered}"),
        );
    }
    finish(&mut text, done);
    text
}

/// The table of scores.
fn table(job: &Job, done: &[Rendered], text: &mut String) {
    let width = done.iter().map(|one| one.shot.name.chars().count()).max().unwrap_or(0).max(4);
    let _ = writeln!(text, "\n{:width$}  PSNR dB    SSIM       time  views", "view");
    for Rendered { shot, score, times, .. } in done {
        let (psnr, ssim) = score.as_ref().map_or((f64::NAN, f64::NAN), |score| (score.psnr, score.ssim));
        let time = time_text(times.total());
        let (name, views) = (escaped(&shot.name), job.synthesizer.views().names(&shot.views));
        let _ = writeln!(text, "{name:width$}  {psnr:7.2}  {ssim:6.4}  {time:>9}  {}", escaped(&abbreviated(&views)));
    }
    if let Some((psnr, ssim)) = mean(done) {
        let _ = writeln!(text, "{:width$}  {psnr:7.2}  {ssim:6.4}  ({BORDER}-pixel border excluded)", "mean");
    }
    text.push('\n');
}

/// Size, layers and depth range.
fn heading(job: &Job, done: &[Rendered], what: &str) -> String {
    let first = &done[0].shot;
    let near = done.iter().map(|one| one.shot.near).fold(f64::INFINITY, f64::min);
    let far = done.iter().map(|one| one.shot.far).fold(0.0, f64::max);
    let (size, layers) = (format!("{}x{}", first.target.width(), first.target.height()), job.synthesizer.layers());
    let views = counted(first.views.len(), "view");
    format!("{what}, {size}, from {views}, {layers}, depth {near:.4} to {far:.4} scene units\n")
}

/// The shares of uncovered and occluded pixels, and the files.
fn finish(text: &mut String, done: &[Rendered]) {
    let of = if done.len() > 1 { "a picture, at most" } else { "the picture" };
    let uncovered = done.iter().map(|one| one.uncovered_share).fold(0.0, f64::max);
    if uncovered > 0.0 {
        line(text, "uncovered", &format!("{:.2} % of {of}: inpainted", 100.0 * uncovered));
    }
    let occluded = done.iter().map(|one| one.occluded_share).fold(0.0, f64::max);
    if occluded > 0.0 {
        let note = "occluded in every view, rendered from the least occluded";
        line(text, "occluded", &format!("{:.2} % of {of}: {note}", 100.0 * occluded));
    }
    let guessed = done.iter().filter_map(|one| Some((one.guessed_share?, &one.advice)));
    if let Some((share, advice)) = guessed.max_by(|a, b| a.0.total_cmp(&b.0)) {
        let advice = advice.as_ref().map(|advice| format!("; {advice}")).unwrap_or_default();
        line(text, "guessed", &format!("{:.1} % of {of}: no two photos confirm its depth{advice}", 100.0 * share));
    }
    let files: Vec<String> = done.iter().flat_map(|one| &one.files).map(|file| file.display().to_string()).collect();
    if !files.is_empty() {
        line(text, "wrote", &abbreviated(&files.iter().map(String::as_str).collect::<Vec<_>>()));
    }
    if let ([one], true) = (done, files.iter().any(|file| file.ends_with(".json"))) {
        line(text, "scale", &format!("disparity = value / 65535 · {} (1/scene unit)", one.disparity_max));
    }
}

fn line(text: &mut String, label: &str, content: &str) {
    let _ = writeln!(text, "{label:7} {}", escaped(content));
}

/// The first few names, and the number of others.
fn abbreviated(names: &[&str]) -> String {
    let listed = names.iter().take(LISTED_NAMES).copied().collect::<Vec<_>>().join(", ");
    if names.len() > LISTED_NAMES { format!("{listed} and {} more", names.len() - LISTED_NAMES) } else { listed }
}

/// Mean PSNR and SSIM of the pictures that have a score.
fn mean(done: &[Rendered]) -> Option<(f64, f64)> {
    let scores: Vec<_> = done.iter().filter_map(|one| one.score.as_ref()).collect();
    let count = scores.len() as f64;
    let mean = |of: fn(&&Score) -> f64| scores.iter().map(of).sum::<f64>() / count;
    (!scores.is_empty()).then(|| (mean(|score| score.psnr), mean(|score| score.ssim)))
}

/// Median time of each stage, or the sum if the median is 0.
fn line_of_times(text: &mut String, done: &[Rendered], of: &str) {
    let all: Vec<_> = done.iter().map(|one| one.times.stages()).collect();
    let Some(first) = all.first() else { return };
    let stage = |stage: usize| {
        let mut times: Vec<Duration> = all.iter().map(|times| times[stage].1).collect();
        times.sort_unstable();
        let (name, median, sum) = (first[stage].0, times[times.len() / 2], times.iter().sum::<Duration>());
        match (median.is_zero(), sum.is_zero()) {
            (false, _) => Some(format!("{name} {}", time_text(median))),
            (true, false) => Some(format!("{name} {} in total", time_text(sum))),
            (true, true) => None,
        }
    };
    let stages = (0..first.len()).filter_map(stage).collect::<Vec<_>>().join(", ");
    line(text, "time", &format!("{stages}{of}"));
}

/// Checks the option `--scores`, before anything is opened.
pub(super) fn check_scores(file: Option<&Path>, have_truth: bool) -> Result<()> {
    let Some(file) = file else { return Ok(()) };
    let at = file.display();
    if !has_extension(file, &["csv"]) {
        bail!("--scores {at}: expected a name that ends in .csv");
    }
    if !have_truth {
        bail!("--scores {at}: there is no photo to compare with; expected --target or --heldout");
    }
    Ok(())
}

/// The table of the scores.
pub(super) fn csv(done: &[Rendered]) -> String {
    let mut text = "name,psnr,ssim,psnr_covered,uncovered_share,occluded_share,guessed_share,seconds\n".to_owned();
    for one in done {
        let number = |number: Option<f64>| number.map(|number| number.to_string()).unwrap_or_default();
        let (psnr, ssim) = (one.score.as_ref().map(|score| score.psnr), one.score.as_ref().map(|score| score.ssim));
        let seconds = Some(one.times.total().as_secs_f64());
        let (name, uncovered, occluded) = (field(&one.shot.name), one.uncovered_share, one.occluded_share);
        let [psnr, ssim, covered, guessed, seconds] =
            [psnr, ssim, one.psnr_covered, one.guessed_share, seconds].map(number);
        let _ = writeln!(text, "{name},{psnr},{ssim},{covered},{uncovered},{occluded},{guessed},{seconds}");
    }
    text
}

/// A name as a field: quoted where it holds a comma, a quote or the end of a line (RFC 4180).
fn field(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_owned() }
}

/// A picture that is rendered and written.
pub(super) struct Rendered {
    pub(super) shot: Shot,
    pub(super) layers: usize,
    pub(super) times: Times,
    /// Of the picture as it is delivered.
    pub(super) score: Option<Score>,
    /// PSNR in dB of the covered pixels alone, where some are not.
    pub(super) psnr_covered: Option<f64>,
    /// Share of the picture that no view covers, 0 to 1.
    pub(super) uncovered_share: f64,
    /// Share of the pixels whose surface no two photos confirm, 0 to 1; `None` for other layers than surface layers.
    pub(super) guessed_share: Option<f64>,
    /// Why they are many, and what helps.
    pub(super) advice: Option<String>,
    /// Share of the pixels that are occluded in every view by the photos' own depth, 0 to 1.
    pub(super) occluded_share: f64,
    /// Mean share of the photos' depth that other photos confirm, 0 to 1; `None` for other layers than
    /// surface layers, and for a picture of an earlier run.
    pub(super) confirmed_share: Option<f64>,
    /// Share of the pixels on which the photos agree, 0 to 1; `None` with a network too.
    pub(super) agreeing_share: Option<f64>,
    /// Largest disparity, in 1/scene unit.
    pub(super) disparity_max: f32,
    pub(super) files: Vec<PathBuf>,
}
