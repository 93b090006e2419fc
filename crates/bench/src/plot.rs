//! The plot of a sweep: error against time with the Pareto front, or for several sizes time against pixels × layers; without the Python
//! implementations, whose model and composite may be others.

use std::fmt::Write;

use crate::report::{Row, SweepReport};

impl SweepReport {
    /// As a plot, SVG.
    pub fn plot(&self) -> String {
        let scaling = self.rows.iter().any(|row| row.size != self.rows[0].size);
        let place = |row: &Row| {
            if row.reference {
                return None;
            }
            let work = row.size.pixels() as f64 / 1e6 * row.count as f64;
            let (x, y) = if scaling { (work, row.median()) } else { (row.median(), row.rms_error()?) };
            (x > 0.0 && y > 0.0).then_some((x, y))
        };
        let points: Vec<(&Row, (f64, f64))> = self.rows.iter().filter_map(|row| Some((row, place(row)?))).collect();
        let [x_label, y_label] = if scaling {
            ["megapixels × layers", "seconds per picture"]
        } else {
            ["seconds per picture", "error against the photo (RMS, of 255)"]
        };
        let mut series: Vec<Series> = Vec::new();
        for &(row, at) in &points {
            let name = kind(row);
            let index = series.iter().position(|known| known.name == name).unwrap_or_else(|| {
                series.push(Series { name, points: Vec::new() });
                series.len() - 1
            });
            let text = row.count.to_string();
            let title = format!("{}, {}: {:.3} s", row.layers, row.engine, row.median());
            series[index].points.push(Point { at, text, title });
        }
        // More could not be told apart: those with the least error, or time.
        let best = |series: &Series| series.points.iter().map(|point| point.at.1).fold(f64::INFINITY, f64::min);
        series.sort_by(|a, b| best(a).total_cmp(&best(b)));
        series.truncate(MAX_SERIES);
        let on_front = points.iter().filter(|(row, _)| !scaling && self.on_front(row));
        let mut dashed: Vec<(f64, f64)> = on_front.map(|&(_, at)| at).collect();
        dashed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let x = Axis::new(x_label, points.iter().map(|(_, at)| at.0));
        let y = Axis::new(y_label, points.iter().map(|(_, at)| at.1));
        let front = if scaling { "" } else { "; dashed: the Pareto front" };
        let caption = format!("Numbers: layers through the network{front}.");
        Svg { caption, x, y, dashed, series }.text()
    }
}

/// The kind of a row, which has a colour of its own: kind of layers and engine.
fn kind(row: &Row) -> String {
    format!("{}, {}", row.layers.split(':').next().unwrap_or_default(), row.engine)
}

/// Space around the axes: left, right, top, bottom.
const MARGINS: [f64; 4] = [52.0, 12.0, 30.0, 42.0];
/// Width and height of the panel, without the legend.
const PANEL: (f64, f64) = (840.0, 440.0);
const LEGEND_ITEM: (f64, f64) = (280.0, 20.0);
const MAX_SERIES: usize = 6;
const COLOURS: [&str; MAX_SERIES] = ["#d1495b", "#30638e", "#2e933c", "#edae49", "#7b4fa3", "#555555"];
/// Space of a number beside a point, pixels.
const NUMBER: (f64, f64) = (26.0, 12.0);

/// A plot.
pub(super) struct Svg {
    pub(super) caption: String,
    pub(super) x: Axis,
    pub(super) y: Axis,
    /// The points of a dashed line.
    pub(super) dashed: Vec<(f64, f64)>,
    pub(super) series: Vec<Series>,
}

/// Points of one kind.
pub(super) struct Series {
    pub(super) name: String,
    pub(super) points: Vec<Point>,
}

/// A point, with a text beside it and one that the pointer shows.
pub(super) struct Point {
    pub(super) at: (f64, f64),
    pub(super) text: String,
    pub(super) title: String,
}

/// A logarithmic axis: the values at its ends, and round ones between them.
pub(super) struct Axis {
    label: &'static str,
    low: f64,
    high: f64,
    ticks: Vec<f64>,
}

impl Axis {
    /// An axis around these values.
    pub(super) fn new(label: &'static str, values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)));
        // A margin around the values; a decade if there are none.
        let (low, high) = if high > 0.0 { (low / 1.15, high * 1.15) } else { (0.1, 1.0) };
        let steps: &[f64] = if high / low > 8.0 { &[1.0, 2.0, 5.0] } else { &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0] };
        let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        Self { label, low, high, ticks: all.filter(|tick| (low..=high).contains(tick)).collect() }
    }

    /// The position of a value between `start` and `end`, pixels.
    fn at(&self, value: f64, (start, end): (f64, f64)) -> f64 {
        start + (end - start) * (value / self.low).ln() / (self.high / self.low).ln()
    }
}

impl Svg {
    /// The file.
    pub(super) fn text(&self) -> String {
        let (width, per_row) = (PANEL.0, (PANEL.0 / LEGEND_ITEM.0) as usize);
        let top = 34.0 + LEGEND_ITEM.1 * self.series.len().div_ceil(per_row) as f64;
        let height = top + PANEL.1;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\" \
             fill=\"#222\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        text(&mut svg, (MARGINS[0], 20.0), "start", &self.caption);
        let x = (MARGINS[0], width - MARGINS[1]);
        let y = (height - MARGINS[3], top + MARGINS[2]);
        self.draw_axes(&mut svg, x, y);
        let place = |point: (f64, f64)| (self.x.at(point.0, x), self.y.at(point.1, y));
        let dashed: String =
            self.dashed.iter().map(|&point| place(point)).map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
        if !dashed.is_empty() {
            let _ =
                writeln!(svg, "<polyline points=\"{dashed}\" fill=\"none\" stroke=\"#777\" stroke-dasharray=\"4 3\"/>");
        }
        let mut numbers: Vec<(f64, f64)> = Vec::new();
        for (index, series) in self.series.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            let style = format!("r=\"4\" fill=\"{colour}\" stroke=\"{colour}\" stroke-width=\"1.5\"");
            let left = MARGINS[0] + (index % per_row) as f64 * LEGEND_ITEM.0;
            let below = 40.0 + (index / per_row) as f64 * LEGEND_ITEM.1;
            let _ = writeln!(svg, "<circle cx=\"{left}\" cy=\"{}\" {style}/>", below - 4.0);
            text(&mut svg, (left + 10.0, below), "start", &series.name);
            for point in &series.points {
                let ((x, y), title) = (place(point.at), escaped(&point.title));
                let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" {style}><title>{title}</title></circle>");
                // A number that would cover another is left out; the pointer shows it.
                if numbers.iter().all(|other| (other.0 - x).abs() > NUMBER.0 || (other.1 - y).abs() > NUMBER.1) {
                    text(&mut svg, (x + 6.0, y - 5.0), "start", &point.text);
                    numbers.push((x, y));
                }
            }
        }
        svg + "</svg>\n"
    }

    /// Draws the axes from `x.0` to `x.1` and, upwards, from `y.0` to `y.1`, pixels.
    fn draw_axes(&self, svg: &mut String, x: (f64, f64), y: (f64, f64)) {
        let round = |value: f64| ((value * 1e6).round() / 1e6).to_string();
        for &value in &self.x.ticks {
            let at = self.x.at(value, x);
            let _ = writeln!(svg, "<path d=\"M{at:.1} {}V{}\" stroke=\"#e4e4e4\"/>", y.0, y.1);
            text(svg, (at, y.0 + 15.0), "middle", &round(value));
        }
        for &value in &self.y.ticks {
            let at = self.y.at(value, y);
            let _ = writeln!(svg, "<path d=\"M{} {at:.1}H{}\" stroke=\"#e4e4e4\"/>", x.0, x.1);
            text(svg, (x.0 - 5.0, at + 4.0), "end", &round(value));
        }
        let _ = writeln!(svg, "<path d=\"M{} {}V{}H{}\" fill=\"none\" stroke=\"#333\"/>", x.0, y.1, y.0, x.1);
        text(svg, ((x.0 + x.1) / 2.0, y.0 + 33.0), "middle", self.x.label);
        text(svg, (x.0, y.1 - 9.0), "start", self.y.label);
    }
}

fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, content: &str) {
    if !content.is_empty() {
        let content = escaped(content);
        let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{content}</text>");
    }
}

/// Text with the characters escaped that SVG reserves.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use crate::report::tests::sweep;

    #[test]
    fn slower_rows_are_further_right_and_larger_errors_higher() {
        let svg = sweep().plot();
        let at = |title: &str| {
            let mark = svg.lines().find(|line| line.contains(title)).unwrap();
            let number = |key: &str| mark.split(key).nth(1).unwrap().split('"').next().unwrap().parse::<f64>().unwrap();
            (number("cx=\""), number("cy=\""))
        };
        let (planes, guided) = (at("planes:64, test"), at("guided:4, test"));
        assert!(planes.0 > guided.0 && planes.1 < guided.1, "{planes:?} {guided:?}");
        assert_eq!(svg.matches("<title>").count(), 4);
        assert!(svg.contains("polyline") && svg.ends_with("</svg>\n"));
    }

    #[test]
    fn several_sizes_show_time_against_work() {
        let mut sweep = sweep();
        sweep.rows[1].size = liveview::geometry::Size::new(80, 60);
        let svg = sweep.plot();
        assert!(svg.contains("megapixels × layers") && !svg.contains("polyline"), "{svg}");
    }
}
