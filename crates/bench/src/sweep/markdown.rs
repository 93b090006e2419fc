//! The sweep as a Markdown table.

use std::fmt::Write;

use super::rows::{Row, SweepReport};

/// A heading that says how the rows were measured, and a row for each configuration.
pub(crate) fn markdown(sweep: &SweepReport) -> String {
    let sizes: Vec<_> = sweep.rows.iter().map(|row| row.size).collect();
    let several_sizes = sizes.iter().any(|&size| size != sizes[0]);
    let mut text = format!(
        "{}, {}{} from {} views, {} threads, batch {}, {}; models: {}; {} interleaved repetitions, each configuration in its own process; \
         scores against the held-out photos.\n\n",
        sweep.scene,
        sweep.targets.join(" and "),
        if several_sizes { String::new() } else { format!(" at {}", sizes[0]) },
        sweep.views,
        sweep.threads,
        sweep.batch,
        sweep.cpu,
        sweep.model,
        sweep.rows.iter().map(|row| row.runs.len()).max().unwrap_or(0),
    );
    if sweep.noisy() {
        text += "**The machine was busy: the times are unreliable.**\n\n";
    }
    let size = if several_sizes { " size |" } else { "" };
    let _ = writeln!(
        text,
        "| |{size} layers | engine | PSNR dB | SSIM | seconds (range) | MB | longest stage |\n\
         |---|{}---|---|---|---|---|---|---|",
        if several_sizes { "---|" } else { "" }
    );
    for row in sweep.rows.iter().filter(|row| !row.reference) {
        let front = if sweep.on_front(row) { "●" } else { "" };
        let size = if several_sizes { format!(" {} |", row.size) } else { String::new() };
        let [psnr, ssim] = [(row.score.map(|s| s.psnr), 2), (row.score.map(|s| s.ssim), 4)].map(cell);
        let _ = writeln!(
            text,
            "| {front} |{size} {} | {} | {psnr} | {ssim} | {}{} | {} | {} |",
            row.layers,
            row.engine,
            seconds(row),
            if row.once > 0.0 { format!(", once {:.2}", row.once) } else { String::new() },
            megabytes(row),
            longest_stage(row),
        );
    }
    text += "\n●: on the Pareto front of time and PSNR. `once`: the time to select planes or to search the photos' depth, which further frames share.\n";
    text + &references(sweep)
}

/// The Python implementations: time and memory alone, since their model and composite may be others than those above.
fn references(sweep: &SweepReport) -> String {
    let rows: Vec<&Row> = sweep.rows.iter().filter(|row| row.reference).collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut text = "\nPython implementations, with the model for any layers, composited as in the paper, without the photos' depth:\n\n\
                    | layers | engine | seconds (range) | MB |\n|---|---|---|---|\n"
        .to_owned();
    for row in rows {
        let _ = writeln!(text, "| {} | {} | {} | {} |", row.layers, row.engine, seconds(row), megabytes(row));
    }
    text
}

/// The median of the repetitions, and their range.
fn seconds(row: &Row) -> String {
    let totals = row.totals();
    let [first, last] = [totals.first(), totals.last()].map(|total| total.unwrap_or(&f64::NAN));
    format!("{:.3} ({first:.3}–{last:.3})", row.median())
}

fn megabytes(row: &Row) -> String {
    row.peak_memory_bytes.map_or("-".into(), |bytes| format!("{:.0}", bytes as f64 / 1e6))
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
mod tests {
    #[test]
    fn all_rows_have_all_columns() {
        let mut sweep = super::super::rows::tests::sweep();
        let text = super::markdown(&sweep);
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(lines.len(), 2 + sweep.rows.len(), "{text}");
        let columns = |line: &&str| line.matches('|').count();
        assert!(lines.iter().all(|line| columns(line) == columns(&lines[0])), "{text}");
        assert!(
            text.contains("| ● | guided:4 | test | 22.00 | 0.5000 | 1.000 (1.000–1.100) | 300 | network 75% |"),
            "{text}"
        );
        sweep.rows[0].reference = true;
        let text = super::markdown(&sweep);
        let apart = text.split("Python implementations").nth(1).unwrap();
        assert!(
            apart.contains("| planes:64 | test | 11.000 (10.000–12.000) | 300 |") && !apart.contains("guided"),
            "{text}"
        );
    }
}
