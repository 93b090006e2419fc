//! The plot of a sweep: error against time with the Pareto front, or for several sizes time against pixels × layers.

use std::fmt::Write;

use super::report::{Row, SweepReport};

/// Space around the axes: left, right, top, bottom.
const MARGINS: [f64; 4] = [52.0, 12.0, 30.0, 42.0];
/// Width and height of the panel, without the legend.
const PANEL: (f64, f64) = (840.0, 440.0);
const LEGEND_ITEM: (f64, f64) = (280.0, 20.0);
/// Of the kinds of rows. More could not be told apart.
const COLOURS: [&str; 6] = ["#d1495b", "#30638e", "#2e933c", "#edae49", "#7b4fa3", "#555555"];
/// Space of a number beside a point, pixels.
const NUMBER: (f64, f64) = (26.0, 12.0);

impl SweepReport {
    /// As a plot, SVG.
    pub(super) fn plot(&self) -> String {
        let scaling = self.rows.iter().any(|row| row.size != self.rows[0].size);
        let place = |row: &Row| {
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
        // Each kind of rows, by its least error, or time.
        let mut kinds: Vec<(String, f64)> = Vec::new();
        for &(row, (_, y)) in &points {
            match kinds.iter_mut().find(|(name, _)| *name == kind(row)) {
                Some((_, least)) => *least = least.min(y),
                None => kinds.push((kind(row), y)),
            }
        }
        kinds.sort_by(|a, b| a.1.total_cmp(&b.1));
        kinds.truncate(COLOURS.len());

        let (width, per_row) = (PANEL.0, (PANEL.0 / LEGEND_ITEM.0) as usize);
        let top = 34.0 + LEGEND_ITEM.1 * kinds.len().div_ceil(per_row) as f64;
        let height = top + PANEL.1;
        let (left, right) = (MARGINS[0], width - MARGINS[1]);
        let (bottom, top) = (height - MARGINS[3], top + MARGINS[2]);
        let x = Axis::new((left, right), points.iter().map(|(_, at)| at.0));
        let y = Axis::new((bottom, top), points.iter().map(|(_, at)| at.1));
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\" \
             fill=\"#222\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        let front = if scaling { "" } else { "; dashed: the Pareto front" };
        text(&mut svg, (left, 20.0), "start", &format!("Numbers: layers through the network{front}."));
        for (at, value) in x.ticks() {
            let _ = writeln!(svg, "<path d=\"M{at:.1} {bottom}V{top}\" stroke=\"#e4e4e4\"/>");
            text(&mut svg, (at, bottom + 15.0), "middle", &value);
        }
        for (at, value) in y.ticks() {
            let _ = writeln!(svg, "<path d=\"M{left} {at:.1}H{right}\" stroke=\"#e4e4e4\"/>");
            text(&mut svg, (left - 5.0, at + 4.0), "end", &value);
        }
        let _ = writeln!(svg, "<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"#333\"/>");
        text(&mut svg, ((left + right) / 2.0, bottom + 33.0), "middle", x_label);
        text(&mut svg, (left, top - 9.0), "start", y_label);
        let on_front = points.iter().filter(|(row, _)| !scaling && self.on_front(row));
        let mut dashed: Vec<(f64, f64)> = on_front.map(|&(_, at)| at).collect();
        dashed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let dashed: String = dashed.iter().map(|at| format!("{:.1},{:.1} ", x.at(at.0), y.at(at.1))).collect();
        if !dashed.is_empty() {
            let _ =
                writeln!(svg, "<polyline points=\"{dashed}\" fill=\"none\" stroke=\"#777\" stroke-dasharray=\"4 3\"/>");
        }
        let mut numbers: Vec<(f64, f64)> = Vec::new();
        for (index, ((name, _), colour)) in kinds.iter().zip(COLOURS).enumerate() {
            let style = format!("r=\"4\" fill=\"{colour}\" stroke=\"{colour}\" stroke-width=\"1.5\"");
            let across = left + (index % per_row) as f64 * LEGEND_ITEM.0;
            let below = 40.0 + (index / per_row) as f64 * LEGEND_ITEM.1;
            let _ = writeln!(svg, "<circle cx=\"{across}\" cy=\"{}\" {style}/>", below - 4.0);
            text(&mut svg, (across + 10.0, below), "start", name);
            for (row, at) in points.iter().filter(|(row, _)| kind(row) == *name) {
                let title = escaped(&format!("{}: {:.3} s", row.name(), row.median()));
                let (x, y) = (x.at(at.0), y.at(at.1));
                let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" {style}><title>{title}</title></circle>");
                // A number that would cover another is left out; the pointer shows it.
                if numbers.iter().all(|other| (other.0 - x).abs() > NUMBER.0 || (other.1 - y).abs() > NUMBER.1) {
                    text(&mut svg, (x + 6.0, y - 5.0), "start", &row.count.to_string());
                    numbers.push((x, y));
                }
            }
        }
        svg + "</svg>\n"
    }
}

/// The kind of a row, which has a colour of its own: kind of layers and engine.
fn kind(row: &Row) -> String {
    format!("{}, {}", row.layers.split(':').next().unwrap_or_default(), row.engine)
}

/// A logarithmic axis: the values at its ends, and where these are, pixels.
struct Axis {
    low: f64,
    high: f64,
    ends: (f64, f64),
}

impl Axis {
    /// An axis around these values.
    fn new(ends: (f64, f64), values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)));
        // A margin around the values; a decade if there are none.
        let (low, high) = if high > 0.0 { (low / 1.15, high * 1.15) } else { (0.1, 1.0) };
        Self { low, high, ends }
    }

    /// The position of a value, pixels.
    fn at(&self, value: f64) -> f64 {
        self.ends.0 + (self.ends.1 - self.ends.0) * (value / self.low).ln() / (self.high / self.low).ln()
    }

    /// Round values between the ends, and their positions.
    fn ticks(&self) -> impl Iterator<Item = (f64, String)> {
        let wide: &[f64] = &[1.0, 2.0, 5.0];
        let steps = if self.high / self.low > 8.0 { wide } else { &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0] };
        let decades = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        let within = all.filter(|tick| (self.low..=self.high).contains(tick));
        within.map(|tick| (self.at(tick), ((tick * 1e6).round() / 1e6).to_string()))
    }
}

fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, content: &str) {
    let content = escaped(content);
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{content}</text>");
}

/// Text with the characters escaped that SVG reserves.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use crate::commands::sweep::report::tests::sweep;

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
