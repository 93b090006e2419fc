//! The plot of the errors, a panel for each family of cases.

use super::outcome::Outcome;
use super::table::{Table, errors};
use crate::plot::{Axis, Panel, Plot, Point, Series};

/// Range of the errors, powers of ten; errors beyond lie on its ends.
const ERROR_POWERS: (i32, i32) = (-10, 1);

/// The plot, as SVG.
pub(crate) fn plot(table: &Table) -> String {
    let is_measured = |kind: &usize| table.outcomes.iter().any(|outcome| errors(outcome)[*kind].1.is_some());
    let measured: Vec<usize> = (0..4).filter(is_measured).collect();
    let legend = measured.iter().map(|&kind| (errors(&table.outcomes[0])[kind].0.to_owned(), false)).collect();
    let caption = "Largest error against float64 outside doubtful pixels; dashed: the bound; top line: not finite.";
    let panels = table.families().map(|family| panel(family, &measured)).collect();
    Plot { caption: caption.to_owned(), legend, panels, columns: 4, panel_size: (255.0, 185.0) }.svg()
}

/// A family: its cases in order, a series for each implementation.
fn panel(family: &[Outcome], implementations: &[usize]) -> Panel {
    let (first, last) = (&family[0], &family[family.len() - 1]);
    let cases = || family.iter().enumerate();
    let series = |(kind, &implementation): (usize, &usize)| {
        let point = |(index, case): (usize, &Outcome)| {
            let error = errors(case)[implementation].1?.largest;
            Some(Point { at: (index as f64, error), text: String::new(), title: format!("{}: {error:.1e}", case.name) })
        };
        Series { kind, points: cases().filter_map(point).collect(), joined: true }
    };
    Panel {
        title: format!("{}: {}", first.stage, first.family),
        x: Axis::items(family.len(), &shortened(&first.name), &shortened(&last.name)),
        y: Axis::powers(ERROR_POWERS.0, ERROR_POWERS.1),
        dashed: cases().map(|(index, case)| (index as f64, case.bound)).collect(),
        // Rust last, on top of the others.
        series: implementations.iter().enumerate().map(series).rev().collect(),
    }
}

/// A name shortened to fit under half a panel.
fn shortened(name: &str) -> String {
    const MAX_CHARS: usize = 20;
    let short = || name.chars().take(MAX_CHARS - 1).chain(['…']).collect();
    if name.chars().count() > MAX_CHARS { short() } else { name.to_owned() }
}
