//! The plot of a sweep: error against time with the Pareto front, or for several sizes time against pixels × layers; without the Python
//! implementations, whose model and composite may be others.

use super::rows::{Row, SweepReport};
use super::svg::{Axis, Point, Series, Svg};

/// The plot, as SVG.
pub(crate) fn plot(sweep: &SweepReport) -> String {
    let scaling = sweep.rows.iter().any(|row| row.size != sweep.rows[0].size);
    let place = |row: &Row| {
        if row.reference {
            return None;
        }
        let work = row.megapixels() * row.count as f64;
        let (x, y) = if scaling { (work, row.median()) } else { (row.median(), row.rms_error()?) };
        (x > 0.0 && y > 0.0).then_some((x, y))
    };
    let points: Vec<(&Row, (f64, f64))> = sweep.rows.iter().filter_map(|row| Some((row, place(row)?))).collect();
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
    let on_front = points.iter().filter(|(row, _)| !scaling && sweep.on_front(row));
    let mut dashed: Vec<(f64, f64)> = on_front.map(|&(_, at)| at).collect();
    dashed.sort_by(|a, b| a.0.total_cmp(&b.0));
    let x = Axis::new(x_label, points.iter().map(|(_, at)| at.0));
    let y = Axis::new(y_label, points.iter().map(|(_, at)| at.1));
    let front = if scaling { "" } else { "; dashed: the Pareto front" };
    let caption = format!("Numbers: layers through the network{front}.");
    Svg { caption, x, y, dashed, series }.text()
}

/// The kind of a row, which has a colour of its own: kind of layers and engine.
fn kind(row: &Row) -> String {
    format!("{}, {}", row.layers.split(':').next().unwrap_or_default(), row.engine)
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::sweep;

    #[test]
    fn slower_rows_are_further_right_and_larger_errors_higher() {
        let svg = super::plot(&sweep());
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
        let svg = super::plot(&sweep);
        assert!(svg.contains("megapixels × layers") && !svg.contains("polyline"), "{svg}");
    }
}
