//! A plot as SVG: panels of points and lines, below a legend that they share.

use std::fmt::Write;

/// Space around a panel's axes: left, right, top, bottom.
const MARGINS: [f64; 4] = [52.0, 12.0, 30.0, 42.0];
const LEGEND_ITEM: (f64, f64) = (280.0, 20.0);
const COLOURS: [&str; 12] = [
    "#d1495b", "#30638e", "#2e933c", "#edae49", "#7b4fa3", "#00798c", "#8d6a4f", "#555555", "#e07be0", "#7fb800",
    "#3dccff", "#000000",
];

/// Panels in rows of `columns`, each of `panel_size` (width, height).
pub(crate) struct Plot {
    pub(crate) caption: String,
    /// The name of each kind of series, and whether its points are hollow.
    pub(crate) legend: Vec<(String, bool)>,
    pub(crate) panels: Vec<Panel>,
    pub(crate) columns: usize,
    pub(crate) panel_size: (f64, f64),
}

/// A pair of axes with its series.
pub(crate) struct Panel {
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    /// The points of a dashed line.
    pub(crate) dashed: Vec<(f64, f64)>,
    pub(crate) series: Vec<Series>,
}

/// Points of one kind.
pub(crate) struct Series {
    /// Index in the legend.
    pub(crate) kind: usize,
    pub(crate) points: Vec<Point>,
    /// Whether a line joins the points.
    pub(crate) joined: bool,
}

/// A point, with a text beside it and one that the pointer shows.
pub(crate) struct Point {
    pub(crate) at: (f64, f64),
    pub(crate) text: String,
    pub(crate) title: String,
}

/// An axis: the values at its ends, with `log` in powers of ten.
pub(crate) struct Axis {
    label: String,
    low: f64,
    high: f64,
    log: bool,
    /// Value, text, and how the text is anchored.
    ticks: Vec<(f64, String, &'static str)>,
}

impl Axis {
    /// A logarithmic axis around these values, with round numbers.
    pub(crate) fn log(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)));
        // A margin around the values; a decade if there are none.
        let (low, high) = if high > 0.0 { (low / 1.15, high * 1.15) } else { (0.1, 1.0) };
        let steps: &[f64] = if high / low > 8.0 { &[1.0, 2.0, 5.0] } else { &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0] };
        let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        let round = |value: f64| ((value * 1e6).round() / 1e6).to_string();
        let ticks = all.filter(|tick| (low..=high).contains(tick)).map(|tick| (tick, round(tick), "middle"));
        Self { label: label.to_owned(), low, high, log: true, ticks: ticks.collect() }
    }

    /// A logarithmic axis from one power of ten to another; values beyond lie on its ends.
    pub(crate) fn powers(low: i32, high: i32) -> Self {
        let ticks = (low..=high).step_by(2).map(|power| (10f64.powi(power), format!("1e{power}"), "middle"));
        Self { label: String::new(), low: 10f64.powi(low), high: 10f64.powi(high), log: true, ticks: ticks.collect() }
    }

    /// A linear axis of items counted from 0, of which the first and the last are named.
    pub(crate) fn items(count: usize, first: &str, last: &str) -> Self {
        let (low, high) = (-0.5, count as f64 - 0.5);
        let mut ticks = vec![(low, first.to_owned(), "start")];
        if count > 1 {
            ticks.push((high, last.to_owned(), "end"));
        }
        Self { label: String::new(), low, high, log: false, ticks }
    }

    /// The position of a value between `start` and `end`, pixels. What is not finite lies on the high end.
    fn at(&self, value: f64, (start, end): (f64, f64)) -> f64 {
        let value = if value.is_finite() { value.clamp(self.low, self.high) } else { self.high };
        let scale = |value: f64| if self.log { value.ln() } else { value };
        start + (end - start) * (scale(value) - scale(self.low)) / (scale(self.high) - scale(self.low))
    }
}

impl Plot {
    pub(crate) fn svg(&self) -> String {
        let (panel_width, panel_height) = self.panel_size;
        let columns = self.columns.min(self.panels.len()).max(1);
        let width = panel_width * columns as f64;
        let per_row = ((width / LEGEND_ITEM.0) as usize).max(1);
        let top = 34.0 + LEGEND_ITEM.1 * self.legend.len().div_ceil(per_row) as f64;
        let height = top + panel_height * self.panels.len().div_ceil(columns) as f64;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\" \
             fill=\"#222\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        text(&mut svg, (MARGINS[0], 20.0), "start", &self.caption);
        for (kind, (name, _)) in self.legend.iter().enumerate() {
            let x = MARGINS[0] + (kind % per_row) as f64 * LEGEND_ITEM.0;
            let y = 40.0 + (kind / per_row) as f64 * LEGEND_ITEM.1;
            let _ = writeln!(svg, "<circle cx=\"{x}\" cy=\"{}\" r=\"4\" {}/>", y - 4.0, self.style(kind));
            text(&mut svg, (x + 10.0, y), "start", name);
        }
        for (index, panel) in self.panels.iter().enumerate() {
            let (left, row_top) =
                ((index % columns) as f64 * panel_width, top + (index / columns) as f64 * panel_height);
            let x = (left + MARGINS[0], left + panel_width - MARGINS[1]);
            let y = (row_top + panel_height - MARGINS[3], row_top + MARGINS[2]);
            panel.axes(&mut svg, x, y);
            self.draw_series(&mut svg, panel, |point| (panel.x.at(point.0, x), panel.y.at(point.1, y)));
        }
        svg + "</svg>\n"
    }

    /// Fill and stroke of a kind of points.
    fn style(&self, kind: usize) -> String {
        let colour = COLOURS[kind % COLOURS.len()];
        let fill = if self.legend[kind].1 { "white" } else { colour };
        format!("fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.5\"")
    }

    fn draw_series(&self, svg: &mut String, panel: &Panel, place: impl Fn((f64, f64)) -> (f64, f64)) {
        line(svg, panel.dashed.iter().map(|&point| place(point)), "stroke=\"#777\" stroke-dasharray=\"4 3\"");
        for series in &panel.series {
            if series.joined {
                let style = format!("stroke=\"{}\" stroke-opacity=\"0.5\"", COLOURS[series.kind % COLOURS.len()]);
                line(svg, series.points.iter().map(|point| place(point.at)), &style);
            }
            for point in &series.points {
                let (x, y) = place(point.at);
                let (style, title) = (self.style(series.kind), escaped(&point.title));
                let _ = writeln!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{}\" {style}><title>{title}</title></circle>",
                    if series.joined { 2 } else { 4 }
                );
                text(svg, (x + 6.0, y - 5.0), "start", &point.text);
            }
        }
    }
}

impl Panel {
    /// Draws the axes from `x.0` to `x.1` and, upwards, from `y.0` to `y.1`, pixels.
    fn axes(&self, svg: &mut String, x: (f64, f64), y: (f64, f64)) {
        for (value, name, anchor) in &self.x.ticks {
            let at = self.x.at(*value, x);
            if self.x.log {
                let _ = writeln!(svg, "<path d=\"M{at:.1} {}V{}\" stroke=\"#e4e4e4\"/>", y.0, y.1);
            }
            text(svg, (at, y.0 + 15.0), anchor, name);
        }
        for (value, name, _) in &self.y.ticks {
            let at = self.y.at(*value, y);
            let _ = writeln!(svg, "<path d=\"M{} {at:.1}H{}\" stroke=\"#e4e4e4\"/>", x.0, x.1);
            text(svg, (x.0 - 5.0, at + 4.0), "end", name);
        }
        let _ = writeln!(svg, "<path d=\"M{} {}V{}H{}\" fill=\"none\" stroke=\"#333\"/>", x.0, y.1, y.0, x.1);
        text(svg, ((x.0 + x.1) / 2.0, y.0 + 33.0), "middle", &self.x.label);
        let title = if self.title.is_empty() { &self.y.label } else { &self.title };
        text(svg, (x.0, y.1 - 9.0), "start", title);
    }
}

fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, content: &str) {
    if !content.is_empty() {
        let content = escaped(content);
        let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{content}</text>");
    }
}

fn line(svg: &mut String, points: impl Iterator<Item = (f64, f64)>, style: &str) {
    let points: String = points.map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
    if !points.is_empty() {
        let _ = writeln!(svg, "<polyline points=\"{points}\" fill=\"none\" {style}/>");
    }
}

/// Text with the characters escaped that SVG reserves.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
