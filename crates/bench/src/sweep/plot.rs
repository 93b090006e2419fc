//! The sweep as a plot (SVG): error against time, both axes logarithmic, the Pareto front drawn; or, where several sizes were
//! measured, time against pixels × layers.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::rows::{Row, SweepReport};
use crate::svg::{escaped, svg_start};

const WIDTH: f64 = 840.0;
const HEIGHT: f64 = 460.0;
const MARGINS: [f64; 4] = [64.0, 330.0, 30.0, 50.0]; // left, right (for the legend), top, bottom
const COLOURS: [&str; 12] = [
    "#d1495b", "#30638e", "#2e933c", "#edae49", "#7b4fa3", "#00798c", "#8d6a4f", "#555555", "#e07be0", "#7fb800",
    "#3dccff", "#000000",
];

/// A mark of the plot, and the row that it shows.
struct Mark<'a> {
    x: f64,
    y: f64,
    row: &'a Row,
}

/// The plot, as SVG.
pub(crate) fn plot(sweep: &SweepReport) -> String {
    let scaling = sweep.rows.iter().any(|row| row.size != sweep.rows[0].size);
    let mark = |row| -> Option<Mark<'_>> {
        let work = Row::megapixels(row) * row.count as f64;
        let (x, y) = if scaling { (work, row.median()) } else { (row.median(), row.levels()?) };
        (x > 0.0 && y > 0.0).then_some(Mark { x, y, row })
    };
    let marks: Vec<Mark<'_>> = sweep.rows.iter().filter_map(mark).collect();
    let [across, up] = if scaling {
        ["megapixels × layers", "seconds per picture"]
    } else {
        ["seconds per picture", "error against the photo (RMS, of 255)"]
    };
    let [x, y] = [
        Axis::new(marks.iter().map(|m| m.x), MARGINS[0], WIDTH - MARGINS[1]),
        Axis::new(marks.iter().map(|m| m.y), HEIGHT - MARGINS[3], MARGINS[2]),
    ];
    let mut svg = svg_start((WIDTH, HEIGHT), 12);
    axes(&mut svg, (&x, across), (&y, up));
    if !scaling {
        let mut front: Vec<_> =
            marks.iter().filter(|m| sweep.on_front(m.row)).map(|m| (x.at(m.x), y.at(m.y))).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        let points: String = front.iter().map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
        let _ = writeln!(svg, "<polyline points=\"{points}\" fill=\"none\" stroke=\"#999\" stroke-dasharray=\"4 3\"/>");
    }
    let mut kinds = BTreeMap::new();
    for mark in &marks {
        let next = kinds.len();
        kinds.entry(kind(mark.row)).or_insert((next, mark.row.reference));
    }
    for mark in &marks {
        let style = style(kinds[&kind(mark.row)]);
        let (at_x, at_y) = (x.at(mark.x), y.at(mark.y));
        let title = format!("{}, {}: {:.3} s", mark.row.layers, mark.row.engine, mark.row.median());
        let _ = writeln!(
            svg,
            "<circle cx=\"{at_x:.1}\" cy=\"{at_y:.1}\" r=\"4.5\" {style}><title>{}</title></circle>",
            escaped(&title)
        );
        if !mark.row.reference {
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\">{}</text>",
                at_x + 6.0,
                at_y - 5.0,
                mark.row.count
            );
        }
    }
    for (kind, &(index, reference)) in &kinds {
        let (left, top) = (WIDTH - MARGINS[1] + 16.0, MARGINS[2] + 10.0 + 20.0 * index as f64);
        let _ = writeln!(svg, "<circle cx=\"{left}\" cy=\"{top}\" r=\"4.5\" {}/>", style((index, reference)));
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\">{}</text>", left + 10.0, top + 4.0, escaped(kind));
    }
    svg + "</svg>\n"
}

/// A colour per kind; marks of the references are hollow.
fn style((index, reference): (usize, bool)) -> String {
    let colour = COLOURS[index % COLOURS.len()];
    let fill = if reference { "white" } else { colour };
    format!("fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.5\"")
}

/// The kind of a row, which has a colour of its own: kind of layers and engine.
fn kind(row: &Row) -> String {
    let layers = row.layers.split(':').next().unwrap_or_default();
    if row.reference { row.engine.clone() } else { format!("{layers}, {}", row.engine) }
}

/// A logarithmic axis from `start` to `end`, pixels.
struct Axis {
    low: f64,
    high: f64,
    start: f64,
    end: f64,
}

impl Axis {
    fn new(values: impl Iterator<Item = f64>, start: f64, end: f64) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)));
        // A margin around the values; a decade if there are none.
        let (low, high) = if high > 0.0 { (low / 1.15, high * 1.15) } else { (0.1, 1.0) };
        Self { low, high, start, end }
    }

    fn at(&self, value: f64) -> f64 {
        self.start + (self.end - self.start) * (value / self.low).ln() / (self.high / self.low).ln()
    }

    /// Round numbers on the axis: 1, 2 and 5 of each decade, more of them on a short axis.
    fn ticks(&self) -> Vec<f64> {
        let decades = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let steps: &[f64] =
            if self.high / self.low > 8.0 { &[1.0, 2.0, 5.0] } else { &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0] };
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        all.filter(|tick| (self.low..=self.high).contains(tick)).collect()
    }
}

fn axes(svg: &mut String, (x, across): (&Axis, &str), (y, up): (&Axis, &str)) {
    for tick in x.ticks() {
        let at = x.at(tick);
        let _ = writeln!(svg, "<path d=\"M{at:.1} {}V{}\" stroke=\"#e4e4e4\"/>", y.start, y.end);
        let _ = writeln!(
            svg,
            "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            y.start + 16.0,
            tick_text(tick)
        );
    }
    for tick in y.ticks() {
        let at = y.at(tick);
        let _ = writeln!(svg, "<path d=\"M{} {at:.1}H{}\" stroke=\"#e4e4e4\"/>", x.start, x.end);
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            x.start - 6.0,
            at + 4.0,
            tick_text(tick)
        );
    }
    let _ = writeln!(svg, "<path d=\"M{} {}V{}H{}\" fill=\"none\" stroke=\"#333\"/>", x.start, y.end, y.start, x.end);
    let middle = (x.start + x.end) / 2.0;
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{across}</text>", y.start + 36.0);
    let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\">{up}</text>", x.start, y.end - 10.0);
}

fn tick_text(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    rounded.to_string()
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::sweep;

    #[test]
    fn better_is_lower_and_slower_is_further_right() {
        let svg = super::plot(&sweep());
        let marks: Vec<(f64, f64)> = svg
            .lines()
            .filter(|line| line.contains("<title>"))
            .map(|line| {
                let number = |key: &str| line.split(key).nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
                (number("cx=\""), number("cy=\""))
            })
            .collect();
        assert_eq!(marks.len(), 4);
        assert!(marks[0].0 > marks[1].0, "64 planes take longer than 4 layers");
        assert!(marks[0].1 < marks[1].1, "their error is larger: higher up");
        assert!(svg.contains("polyline") && svg.ends_with("</svg>\n"));
    }

    #[test]
    fn several_sizes_show_time_against_work() {
        let mut sweep = sweep();
        sweep.rows[1].size = liveview::geometry::Size::new(80, 60);
        let svg = super::plot(&sweep);
        assert!(svg.contains("megapixels × layers") && !svg.contains("polyline"), "{svg}");
    }
}
