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
        "| |{size} layers | engine | PSNR dB | SSIM | seconds (range) | MB | time goes to |\n\
         |---|{}---|---|---|---|---|---|---|",
        if several_sizes { "---|" } else { "" }
    );
    for row in &sweep.rows {
        let front = if sweep.on_front(row) { "●" } else { "" };
        let size = if several_sizes { format!(" {} |", row.size) } else { String::new() };
        let [psnr, ssim] = [(row.score.map(|s| s.psnr), 2), (row.score.map(|s| s.ssim), 4)].map(cell);
        let totals = row.totals();
        let _ = writeln!(
            text,
            "| {front} |{size} {} | {} | {psnr} | {ssim} | {:.3} ({:.3} to {:.3}){} | {} | {} |",
            row.layers,
            row.engine,
            row.median(),
            totals.first().unwrap_or(&f64::NAN),
            totals.last().unwrap_or(&f64::NAN),
            if row.once > 0.0 { format!(", once {:.2}", row.once) } else { String::new() },
            row.peak_memory_bytes.map_or("-".into(), |bytes| format!("{:.0}", bytes as f64 / 1e6)),
            shares(row),
        );
    }
    if sweep.rows.iter().any(|row| row.reference) {
        text += "\nThe rows of PyTorch and ONNX Runtime composite as in the paper, with the model for any layers; they are scored on the first target.\n";
    }
    text += "\n●: on the Pareto front of time and PSNR. `once`: the time to select planes or to search the photos' depth, which further frames share.\n";
    text
}

/// A number as a cell of the table.
fn cell((value, digits): (Option<f64>, usize)) -> String {
    value.map_or("-".into(), |value| format!("{value:.digits$}"))
}

/// Each stage's share of the time, the largest first.
fn shares(row: &Row) -> String {
    let mut stages = row.stages();
    let total: f64 = stages.iter().map(|(_, time)| time).sum();
    stages.sort_by(|a, b| b.1.total_cmp(&a.1));
    stages.iter().map(|(stage, time)| format!("{stage} {:.0} %", 100.0 * time / total)).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    #[test]
    fn all_rows_have_all_columns() {
        let sweep = super::super::rows::tests::sweep();
        let text = super::markdown(&sweep);
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(lines.len(), 2 + sweep.rows.len(), "{text}");
        let columns = |line: &&str| line.matches('|').count();
        assert!(lines.iter().all(|line| columns(line) == columns(&lines[0])), "{text}");
        assert!(text.contains("| ● | guided:4 | test | 22.00 | 0.5000 | 1.000 (1.000 to 1.100) | 300 |"), "{text}");
    }
}
