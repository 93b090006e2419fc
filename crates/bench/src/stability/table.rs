//! The outcomes as Markdown, with a line for each family and each case.

use std::fmt::Write;

use super::outcome::{Errors, Outcome, Verdict};

/// The results of all cases.
pub(crate) struct Table {
    /// The rig and the model, one line.
    pub(crate) about: String,
    pub(crate) outcomes: Vec<Outcome>,
}

impl Table {
    /// The families in their order, each with its outcomes.
    pub(super) fn families(&self) -> impl Iterator<Item = &[Outcome]> {
        self.outcomes.chunk_by(|a, b| a.family == b.family)
    }

    pub(crate) fn failed(&self) -> usize {
        self.outcomes.iter().filter(|outcome| !outcome.holds()).count()
    }
}

/// The errors of the four implementations; `None` for one that was not run or lacks the stage.
pub(super) fn errors(outcome: &Outcome) -> [(&'static str, Option<Errors>); 4] {
    [
        ("Rust", outcome.rust.clone().ok().flatten()),
        ("torch", outcome.torch),
        ("kornia", outcome.kornia),
        ("onnxruntime", outcome.onnxruntime),
    ]
}

const HOW_TO_READ: &str = "\
Errors are the largest of a case against float64, of values in [0, 1], or relative to the largest (disparity, logits, stiff composites);
\"covered\" is the share of the pixels that the source covers. **Bold** is beyond the bound, *NaN* is not finite. Doubtful pixels, whose
value depends on bits that float32 inputs do not have, are counted separately: of those at most 1 % may be beyond the bound. Torch, kornia
(unmodified: it does not mask points behind the camera) and onnxruntime compute in float32. Rust's error must be within the bound and at
most twice torch's, or 1.2e-7.";

pub(crate) fn markdown(table: &Table) -> String {
    let mut text = format!("# Stiff and extreme cases\n\n{}\n\n{HOW_TO_READ}\n\n", table.about);
    let count = table.outcomes.len();
    let _ = writeln!(text, "{} of {count} cases pass.\n", count - table.failed());
    text += "| stage | varied | from | to | cases | Rust | torch | kornia | onnxruntime | |\n|---|---|---|---|---|---|---|---|---|---|\n";
    for family in table.families() {
        let (first, last) = (&family[0], &family[family.len() - 1]);
        let _ =
            write!(text, "| {} | {} | {} | {} | {} |", first.stage, first.family, first.name, last.name, family.len());
        for implementation in 0..4 {
            let worst = family.iter().max_by(|a, b| largest(a, implementation).total_cmp(&largest(b, implementation)));
            let _ = write!(text, " {} |", worst.map_or_else(String::new, |worst| figure(worst, implementation)));
        }
        let failed = family.iter().filter(|outcome| !outcome.holds()).count();
        let _ = writeln!(text, " {} |", if failed == 0 { "ok".to_owned() } else { format!("{failed} failed") });
    }
    text += "\n| case | | Rust | torch | kornia | onnxruntime | bound | covered | doubtful | |\n|---|---|---|---|---|---|---|---|---|---|\n";
    for outcome in &table.outcomes {
        let figures: Vec<String> = (0..4).map(|implementation| figure(outcome, implementation)).collect();
        let _ = writeln!(
            text,
            "| {} | {} | {} | {:.0e} | {} | {} | {} |",
            outcome.family,
            outcome.name,
            figures.join(" | "),
            outcome.bound,
            outcome.covered.map_or_else(String::new, percent),
            doubtful(outcome),
            verdict(outcome)
        );
    }
    text
}

fn largest(outcome: &Outcome, implementation: usize) -> f64 {
    errors(outcome)[implementation].1.map_or(-1.0, |errors| errors.largest)
}

fn figure(outcome: &Outcome, implementation: usize) -> String {
    match errors(outcome)[implementation].1 {
        None => String::new(),
        Some(errors) if errors.largest.is_infinite() => "*NaN*".into(),
        Some(errors) if errors.largest > outcome.bound => format!("**{:.1e}**", errors.largest),
        Some(errors) if errors.largest == 0.0 => "0".into(),
        Some(errors) => format!("{:.1e}", errors.largest),
    }
}

/// The share of doubtful pixels, and of these the share whose error exceeds the bound.
fn doubtful(outcome: &Outcome) -> String {
    let off = outcome.rust.as_ref().ok().and_then(|rust| rust.as_ref()).map_or(0.0, |rust| rust.doubtful);
    match outcome.doubtful {
        0.0 => String::new(),
        share if off > 0.0 => format!("{}, {} of them off", percent(share), percent(off)),
        share => percent(share),
    }
}

fn percent(share: f64) -> String {
    if share > 0.0 && share < 1e-3 { format!("{:.3} %", 100.0 * share) } else { format!("{:.1} %", 100.0 * share) }
}

fn verdict(outcome: &Outcome) -> String {
    let slower = outcome.relative_time.map_or_else(String::new, |times| format!(", {times:.2} times as long as noise"));
    match outcome.verdict() {
        Verdict::Ok => format!("ok{slower}"),
        Verdict::NotCompared => format!("finite, not compared{slower}"),
        Verdict::Refused(why) => format!("**refused**: {why}"),
        Verdict::Failed(why) => format!("**failed**: {why}{slower}"),
    }
}
