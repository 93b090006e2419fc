//! The measurements of `liveview sweep`: error against run time, a row per configuration.

use std::fmt::Write;

use liveview::geometry::Size;
use liveview_synthesizer::Score;
use serde_json::{Value, json};

/// Spread of the repetitions (interquartile range / median, median over the rows) above which times are unreliable.
const MAX_SPREAD: f64 = 0.15;

/// One configuration, with its run time and its error.
#[derive(Debug, Default)]
pub(crate) struct Row {
    /// Such as `guided:4`.
    pub(crate) layers: String,
    pub(crate) engine: String,
    /// Size of the target, pixels.
    pub(crate) size: Size,
    /// Layers that went through the network.
    pub(crate) count: usize,
    /// Seconds of each repetition, by stage.
    pub(crate) runs: Vec<Vec<(String, f64)>>,
    /// Seconds spent once: to select the planes of all repetitions, or to search the depth of the photos.
    pub(crate) once: f64,
    pub(crate) score: Option<Score>,
    pub(crate) peak_memory_bytes: Option<u64>,
}

impl Row {
    /// The row of a worker, without measurements; `ready`: the worker's first line.
    pub(crate) fn new(layers: &str, ready: &Value, size: Size) -> Self {
        Self {
            layers: layers.to_owned(),
            engine: ready["engine"].as_str().unwrap_or("unnamed").to_owned(),
            size,
            ..Self::default()
        }
    }

    pub(crate) fn name(&self) -> String {
        format!("{}, {}", self.layers, self.engine)
    }

    pub(super) fn along_surface(&self) -> bool {
        self.layers.starts_with("surface:")
    }

    /// Seconds of each repetition, all stages together, sorted.
    pub(crate) fn totals(&self) -> Vec<f64> {
        let mut totals: Vec<f64> = self.runs.iter().map(|run| run.iter().map(|(_, time)| time).sum()).collect();
        totals.sort_by(f64::total_cmp);
        totals
    }

    pub(crate) fn median(&self) -> f64 {
        quantile_of_sorted(&self.totals(), 0.5)
    }

    /// Median seconds of each stage.
    pub(crate) fn stages(&self) -> Vec<(String, f64)> {
        let names = self.runs.first().into_iter().flatten().map(|(name, _)| name);
        let of = |name: &String| {
            let mut times: Vec<f64> =
                self.runs.iter().flatten().filter(|(stage, _)| stage == name).map(|&(_, time)| time).collect();
            (name.clone(), quantile(&mut times, 0.5))
        };
        names.map(of).filter(|&(_, time)| time > 0.0).collect()
    }

    /// Root mean square error against the photos, of values in [0, 255].
    pub(super) fn rms_error(&self) -> Option<f64> {
        self.score.map(|score| 255.0 * 10f64.powf(-score.psnr / 20.0))
    }
}

/// All measurements of a sweep.
#[derive(Debug)]
pub(super) struct SweepReport {
    pub(crate) scene: String,
    pub(crate) targets: Vec<String>,
    pub(crate) views: usize,
    pub(crate) model: String,
    pub(crate) threads: usize,
    pub(crate) batch: usize,
    pub(crate) cpu: String,
    pub(crate) rows: Vec<Row>,
}

impl SweepReport {
    /// Whether the times of the repetitions differ too much.
    pub(super) fn noisy(&self) -> bool {
        // Of each row the interquartile range over the median.
        let spread = |row: &Row| {
            let [low, middle, high] = [0.25, 0.5, 0.75].map(|part| quantile_of_sorted(&row.totals(), part));
            (high - low) / middle
        };
        let mut spreads: Vec<f64> = self.rows.iter().map(spread).collect();
        quantile(&mut spreads, 0.5) > MAX_SPREAD
    }

    /// Whether a row is on the Pareto front: no other row of its size is at least as fast and as accurate, and better in one of these.
    pub(super) fn on_front(&self, row: &Row) -> bool {
        let Some(error) = row.rms_error() else { return false };
        let dominates = |other: &Row| {
            let (time, other_error) = (other.median(), other.rms_error().unwrap_or(f64::INFINITY));
            time <= row.median() && other_error <= error && (time < row.median() || other_error < error)
        };
        !self.rows.iter().any(|other| other.size == row.size && dominates(other))
    }

    /// As a Markdown table: a heading that says how the rows were measured, and a row for each configuration.
    pub(super) fn markdown(&self) -> String {
        let sizes: Vec<_> = self.rows.iter().map(|row| row.size).collect();
        let several_sizes = sizes.iter().any(|&size| size != sizes[0]);
        let mut text = format!(
            "{}, {}{} from {} views, {} threads, batch {}, {}; models: {}; {} interleaved repetitions, each configuration in its own process; \
         scores against the held-out photos.\n\n",
            self.scene,
            self.targets.join(" and "),
            if several_sizes { String::new() } else { format!(" at {}", sizes[0]) },
            self.views,
            self.threads,
            self.batch,
            self.cpu,
            self.model,
            self.rows.iter().map(|row| row.runs.len()).max().unwrap_or(0),
        );
        if self.noisy() {
            text += "**The machine was busy: the times are unreliable.**\n\n";
        }
        let size = if several_sizes { " size |" } else { "" };
        let _ = writeln!(
            text,
            "| |{size} layers | engine | PSNR dB | SSIM | seconds (range) | MB | longest stage |\n\
         |---|{}---|---|---|---|---|---|---|",
            if several_sizes { "---|" } else { "" }
        );
        for row in &self.rows {
            let front = if self.on_front(row) { "●" } else { "" };
            let size = if several_sizes { format!(" {} |", row.size) } else { String::new() };
            let megabytes = row.peak_memory_bytes.map(|bytes| bytes as f64 / 1e6);
            let [psnr, ssim, megabytes] =
                [(row.score.map(|s| s.psnr), 2), (row.score.map(|s| s.ssim), 4), (megabytes, 0)].map(cell);
            let _ = writeln!(
                text,
                "| {front} |{size} {} | {} | {psnr} | {ssim} | {}{} | {megabytes} | {} |",
                row.layers,
                row.engine,
                seconds(row),
                if row.once > 0.0 { format!(", once {:.2}", row.once) } else { String::new() },
                longest_stage(row),
            );
        }
        text += "\n●: on the Pareto front of time and PSNR. `once`: the time to select planes or to search the photos' depth, which further frames share.\n";
        text
    }

    /// As JSON.
    pub(super) fn json(&self) -> Value {
        let row = |row: &Row| {
            let totals = row.totals();
            let stages = row.stages().into_iter().map(|(stage, time)| (stage, json!(time)));
            json!({
                "layers": row.layers, "engine": row.engine, "width": row.size.width, "height": row.size.height,
                "count": row.count, "seconds": {
                    "median": row.median(), "min": totals.first(), "max": totals.last(),
                    "quartiles": [quantile_of_sorted(&totals, 0.25), quantile_of_sorted(&totals, 0.75)], "all": totals,
                    "stages": stages.collect::<serde_json::Map<_, _>>(), "once": row.once,
                },
                "psnr": row.score.map(|score| score.psnr), "ssim": row.score.map(|score| score.ssim),
                "peak_memory_bytes": row.peak_memory_bytes, "on_front": self.on_front(row),
            })
        };
        json!({
            "scene": self.scene, "targets": self.targets, "views": self.views, "model": self.model, "threads": self.threads,
            "batch": self.batch, "cpu": self.cpu, "noisy": self.noisy(), "excluded_border": Score::BORDER,
            "rows": self.rows.iter().map(row).collect::<Vec<_>>(),
        })
    }
}

/// A quantile (`fraction` from 0 to 1) of the values, which it sorts, interpolated linearly between ranks as in NumPy; NaN if
/// there are none.
pub(crate) fn quantile(values: &mut [f64], fraction: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    quantile_of_sorted(values, fraction)
}

fn quantile_of_sorted(sorted: &[f64], fraction: f64) -> f64 {
    let at = fraction * sorted.len().saturating_sub(1) as f64;
    match (sorted.get(at.floor() as usize), sorted.get(at.ceil() as usize)) {
        // Depths may be infinite, and infinity minus infinity is NaN.
        (Some(low), Some(high)) if low == high => *low,
        (Some(low), Some(high)) => low + at.fract() * (high - low),
        _ => f64::NAN,
    }
}

/// The median of the repetitions, and their range.
fn seconds(row: &Row) -> String {
    let totals = row.totals();
    let [first, last] = [totals.first(), totals.last()].map(|total| total.unwrap_or(&f64::NAN));
    format!("{:.3} ({first:.3}–{last:.3})", row.median())
}

/// A number as a cell of the table.
fn cell((value, digits): (Option<f64>, usize)) -> String {
    value.map_or("-".into(), |value| format!("{value:.digits$}"))
}

/// The stage that takes the most time, and its share.
fn longest_stage(row: &Row) -> String {
    let stages = row.stages();
    let total: f64 = stages.iter().map(|(_, time)| time).sum();
    let longest = stages.iter().max_by(|a, b| a.1.total_cmp(&b.1));
    longest.map_or("-".into(), |(stage, time)| format!("{stage} {:.0}%", 100.0 * time / total))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn row(layers: &str, count: usize, times: &[f64], psnr: f64) -> Row {
        let run = |&time: &f64| vec![("depth".to_owned(), 0.25 * time), ("network".to_owned(), 0.75 * time)];
        Row {
            layers: layers.to_owned(),
            engine: "test".to_owned(),
            size: Size::new(40, 30),
            count,
            runs: times.iter().map(run).collect(),
            score: Some(Score { psnr, ssim: 0.5 }),
            peak_memory_bytes: Some(300_000_000),
            ..Row::default()
        }
    }

    pub(crate) fn sweep() -> SweepReport {
        SweepReport {
            scene: "scene".into(),
            targets: vec!["a".into()],
            views: 4,
            model: "model".into(),
            threads: 2,
            batch: 1,
            cpu: "cpu".into(),
            rows: vec![
                row("planes:64", 64, &[10.0, 12.0, 11.0], 20.0),
                row("guided:4", 4, &[1.0, 1.1, 1.0], 22.0),
                row("guided:8", 8, &[2.0, 2.0, 2.0], 21.0),
                row("guided:2", 2, &[0.5, 0.5, 0.5], 21.5),
            ],
        }
    }

    #[test]
    fn rows_have_medians_and_a_front() {
        let sweep = sweep();
        let [dense, four, eight, two] = &sweep.rows[..] else { unreachable!() };
        assert_eq!((dense.median(), dense.stages()[0].1), (11.0, 2.75));
        assert_eq!([dense, four, eight, two].map(|row| sweep.on_front(row)), [false, true, false, true]);
        assert!((four.rms_error().unwrap() - 255.0 * 0.0794).abs() < 0.01);
        assert!(!sweep.noisy());
        assert_eq!(sweep.json()["rows"][1]["on_front"], true);
    }

    #[test]
    fn widely_spread_times_are_noisy() {
        let mut sweep = sweep();
        sweep.rows = vec![row("guided:4", 4, &[1.0, 1.5, 2.0], 20.0)];
        assert!(sweep.noisy());
    }
}

#[cfg(test)]
mod markdown_tests {
    #[test]
    fn all_rows_have_all_columns() {
        let sweep = super::tests::sweep();
        let text = sweep.markdown();
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(lines.len(), 2 + sweep.rows.len(), "{text}");
        let columns = |line: &&str| line.matches('|').count();
        assert!(lines.iter().all(|line| columns(line) == columns(&lines[0])), "{text}");
        assert!(
            text.contains("| ● | guided:4 | test | 22.00 | 0.5000 | 1.000 (1.000–1.100) | 300 | network 75% |"),
            "{text}"
        );
    }
}
