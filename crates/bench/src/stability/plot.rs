//! A plot (SVG) of the errors, a panel per family, which shows where an implementation fails.

use std::fmt::Write;

use super::outcome::Outcome;
use super::table::{Table, errors};
use crate::svg::svg_start;

const COLUMNS: usize = 4;
const PANEL: (f64, f64) = (250.0, 170.0);
/// Margins of a panel: left, right, top, bottom.
const MARGINS: [f64; 4] = [40.0, 10.0, 26.0, 26.0];
const TOP: f64 = 52.0;
const COLOURS: [&str; 4] = ["#d1495b", "#30638e", "#edae49", "#2e933c"];

/// Range of the errors, as powers of ten; smaller ones are drawn on the lowest line, those that are not finite on the highest.
const LOWEST: f64 = -10.0;
const HIGHEST: f64 = 1.0;

pub(crate) fn plot(table: &Table) -> String {
    let families: Vec<&[Outcome]> = table.families().collect();
    let rows = families.len().div_ceil(COLUMNS);
    let (width, height) = (PANEL.0 * COLUMNS as f64, PANEL.1 * rows as f64 + TOP);
    let mut svg = svg_start((width, height), 10);
    let shown =
        |implementation: usize| table.outcomes.iter().any(|outcome| errors(outcome)[implementation].1.is_some());
    for (place, implementation) in (0..4).filter(|&i| shown(i)).enumerate() {
        let (x, name) = (MARGINS[0] + 110.0 * place as f64, errors(&table.outcomes[0])[implementation].0);
        let _ = writeln!(svg, "<circle cx=\"{x}\" cy=\"16\" r=\"4\" fill=\"{}\"/>", COLOURS[implementation]);
        let _ = writeln!(svg, "<text x=\"{}\" y=\"20\" font-size=\"12\">{name}</text>", x + 9.0);
    }
    let about = "Largest error against float64 outside doubtful pixels. Dashed: the bound. Top line: not finite.";
    let _ = writeln!(svg, "<text x=\"{}\" y=\"40\" font-size=\"12\">{about}</text>", MARGINS[0] - 4.0);
    for (index, family) in families.into_iter().enumerate() {
        let corner = ((index % COLUMNS) as f64 * PANEL.0, (index / COLUMNS) as f64 * PANEL.1 + TOP);
        panel(&mut svg, family, corner);
    }
    svg + "</svg>\n"
}

/// Vertical position of an error in a panel.
fn at(error: f64) -> f64 {
    let power = if error.is_finite() { error.log10().clamp(LOWEST, HIGHEST) } else { HIGHEST };
    let inner = PANEL.1 - MARGINS[2] - MARGINS[3];
    MARGINS[2] + inner * (HIGHEST - power) / (HIGHEST - LOWEST)
}

fn panel(svg: &mut String, family: &[Outcome], (left, top): (f64, f64)) {
    let (start, end) = (MARGINS[0], PANEL.0 - MARGINS[1]);
    let step = (end - start) / family.len() as f64;
    let across = |index: usize| start + (index as f64 + 0.5) * step;
    let _ = writeln!(svg, "<g transform=\"translate({left} {top})\">");
    let _ = writeln!(
        svg,
        "<text x=\"{start}\" y=\"18\" font-weight=\"bold\">{}: {}</text>",
        family[0].stage, family[0].family
    );
    for power in (LOWEST as i32..=HIGHEST as i32).step_by(2) {
        let y = at(10f64.powi(power));
        let _ = writeln!(svg, "<path d=\"M{start} {y:.1}H{end}\" stroke=\"#e4e4e4\"/>");
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"8\">1e{power}</text>",
            start - 4.0,
            y + 3.0
        );
    }
    let bounds: String =
        family.iter().enumerate().map(|(i, case)| format!("{:.1},{:.1} ", across(i), at(case.bound))).collect();
    let _ = writeln!(svg, "<polyline points=\"{bounds}\" fill=\"none\" stroke=\"#222\" stroke-dasharray=\"3 3\"/>");
    let end_names = [(start, "start", &family[0]), (end, "end", &family[family.len() - 1])];
    for (x, anchor, case) in if family.len() > 1 { &end_names[..] } else { &end_names[..1] } {
        let _ = writeln!(
            svg,
            "<text x=\"{x}\" y=\"{}\" text-anchor=\"{anchor}\" font-size=\"8\">{}</text>",
            PANEL.1 - 12.0,
            shortened(&case.name)
        );
    }
    // Rust last, on top of the others.
    for implementation in (0..4).rev() {
        let colour = COLOURS[implementation];
        let found = family.iter().enumerate();
        let found: Vec<_> =
            found.filter_map(|(i, case)| Some((i, case, errors(case)[implementation].1?.largest))).collect();
        let points: String =
            found.iter().map(|(i, _, error)| format!("{:.1},{:.1} ", across(*i), at(*error))).collect();
        let _ =
            writeln!(svg, "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-opacity=\"0.5\"/>");
        for (i, case, error) in found {
            let _ = writeln!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.2\" fill=\"{colour}\"><title>{}: {error:.1e}</title></circle>",
                across(i),
                at(error),
                case.name
            );
        }
    }
    svg.push_str("</g>\n");
}

/// A name shortened to fit under half a panel.
fn shortened(name: &str) -> String {
    const FITS: usize = 26;
    let short = || name.chars().take(FITS - 1).chain(['…']).collect();
    if name.chars().count() > FITS { short() } else { name.to_owned() }
}
