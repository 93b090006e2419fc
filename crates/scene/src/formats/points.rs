//! The depth range of a `transforms.json` from points: those of its `ply_file_path`, or those of a
//! COLMAP model in the folder, which nerfstudio keeps in `colmap/sparse/0`. Of a PLY file, text
//! or binary, x, y and z of its first element, `vertex`, are read.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;
use serde_json::Value;

use crate::formats::colmap::{self, Seen};
use crate::scene_file::{read, safe_name};
use crate::{DeclaredView, DeclaredViews};

/// Points that are looked at: more would not change the percentiles.
const MAX_POINTS: usize = 8192;

/// Largest difference of a model's poses from those of the views, as a share of their extent.
const POSE_TOLERANCE: f64 = 0.05;

/// For each view its range of depths, in scene units, if it has one.
type Ranges = Vec<Option<(f64, f64)>>;

/// Sets the depth range of views that have none, and adds a note on where it is from.
pub(crate) fn fill(root: &Path, path: &Path, file: &Value, found: &mut DeclaredViews) {
    if found.views.iter().all(|view| view.depth_range.is_some()) {
        return;
    }
    let mut sources: Vec<(String, Result<Ranges, String>)> = Vec::new();
    if let Some(name) = file.get("ply_file_path").and_then(Value::as_str) {
        let bytes = safe_name(path, name).and_then(|name| read(&root.join(name))).map_err(|error| error.to_string());
        let points = bytes.and_then(|bytes| ply_points(&bytes));
        sources.push((name.to_owned(), points.and_then(|points| in_pictures(&points, found))));
    }
    if let (true, Some((folder, format))) =
        (sources.iter().all(|(_, ranges)| ranges.is_err()), colmap::model_folder(root))
    {
        let model = format.read(&folder).map_err(|error| error.to_string());
        let ranges = model.and_then(|model| of_photos(&colmap::seen(&model), found));
        let name = folder.strip_prefix(root).unwrap_or(&folder).display().to_string();
        sources.push((name, ranges));
    }
    for (name, ranges) in sources {
        match ranges {
            Ok(ranges) => {
                for (view, range) in found.views.iter_mut().zip(ranges) {
                    view.depth_range = view.depth_range.or(range);
                }
                found.notes.push(format!("depth range from the points of {name}"));
            }
            Err(error) => found.notes.push(format!("{name}: its points are not used for the depth range: {error}")),
        }
    }
}

/// For each view the range of depths of the points in its picture.
fn in_pictures(points: &[DVec3], found: &DeclaredViews) -> Result<Ranges, String> {
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    let range = |view: &DeclaredView| {
        let (k, size) = (view.intrinsics, view.size);
        let depths = points.iter().step_by(step).filter_map(|&point| {
            let DVec3 { x, y, z } = view.rotation * point + view.translation;
            let (u, v) = (k.fx * x / z + k.cx, k.fy * y / z + k.cy);
            let inside = (0.0..size.width as f64).contains(&u) && (0.0..size.height as f64).contains(&v);
            (z > 0.0 && inside).then_some(z)
        });
        colmap::depth_range(depths.collect())
    };
    let ranges: Vec<_> = found.views.iter().map(range).collect();
    if ranges.iter().any(Option::is_some) { Ok(ranges) } else { Err("no view sees enough of them".to_owned()) }
}

/// For each view the range of depths of its photo's points in a COLMAP model, in units of the views.
fn of_photos(seen: &HashMap<&str, Seen>, found: &DeclaredViews) -> Result<Ranges, String> {
    let of_view = |view: &DeclaredView| {
        let mut ends = std::iter::successors(Some(&*view.photo.name), |end| Some(end.split_once('/')?.1));
        ends.find_map(|end| seen.get(end))
    };
    let matched: Vec<Option<&Seen>> = found.views.iter().map(of_view).collect();
    let pairs = || found.views.iter().zip(&matched).filter_map(|(view, seen)| Some((view, (*seen)?)));
    let count = pairs().count() as f64;
    let centre = |view: &DeclaredView| -(view.rotation.transpose() * view.translation);
    let middle = pairs().map(|(view, _)| centre(view)).sum::<DVec3>() / count;
    let middle_in_model = pairs().map(|(_, seen)| seen.centre).sum::<DVec3>() / count;
    // Turned, moved and scaled, the cameras keep the ratios of their distances from the middle.
    let distances =
        || pairs().map(|(view, seen)| ((centre(view) - middle).length(), (seen.centre - middle_in_model).length()));
    let (extent, in_model) = distances().fold((0.0, 0.0), |sums, pair| (sums.0 + pair.0, sums.1 + pair.1));
    let scale: f64 = extent / in_model;
    let apart = distances().map(|(own, model)| (own - scale * model).abs()).fold(0.0, f64::max);
    if !(scale > 0.0 && scale.is_finite() && apart <= POSE_TOLERANCE * extent / count) {
        return Err("its poses are not those of the views".to_owned());
    }
    let scaled = |seen: Option<&Seen>| seen?.range.map(|(near, far)| (scale * near, scale * far));
    Ok(matched.into_iter().map(scaled).collect())
}

/// The header of a file: how many points, and where their coordinates are.
struct Header<'a> {
    encoding: &'a str,
    count: usize,
    /// Name, type and size in bytes of each number of a point.
    numbers: Vec<(&'a str, &'a str, usize)>,
}

/// The points; an error says what is wrong and what was expected.
pub(crate) fn ply_points(bytes: &[u8]) -> Result<Vec<DVec3>, String> {
    let mut rest = bytes;
    let mut header: Option<Header<'_>> = None;
    let mut encoding = None;
    let mut is_vertex = false;
    loop {
        let line = next_line(&mut rest).ok_or("no end_header; expected a PLY file")?;
        match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
            ["end_header"] => break,
            ["format", name, _] => encoding = Some(name),
            ["element", "vertex", count] if header.is_none() => {
                let count = count.parse().map_err(|_| format!("{count} vertices; expected a number"))?;
                let encoding = encoding.ok_or("element before format; expected format first")?;
                header = Some(Header { encoding, count, numbers: Vec::new() });
                is_vertex = true;
            }
            ["element", name, _] if header.is_none() => return Err(format!("element {name}; expected vertex first")),
            ["element", ..] => is_vertex = false,
            ["property", kind, name] if is_vertex => {
                let size = match kind {
                    "char" | "int8" | "uchar" | "uint8" => 1,
                    "short" | "int16" | "ushort" | "uint16" => 2,
                    "int" | "int32" | "uint" | "uint32" | "float" | "float32" => 4,
                    "double" | "float64" => 8,
                    _ => return Err(format!("property {kind} {name}; expected a number")),
                };
                header.iter_mut().for_each(|header| header.numbers.push((name, kind, size)));
            }
            ["property", ..] if is_vertex => return Err(format!("{line}; expected a number")),
            _ => {}
        }
    }
    header.ok_or("no element vertex; expected points")?.points(rest)
}

/// The next line of a header, without its end.
fn next_line<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let end = rest.iter().position(|&byte| byte == b'\n')?;
    let line = &rest[..end];
    *rest = &rest[end + 1..];
    std::str::from_utf8(line).ok()
}

impl Header<'_> {
    /// The points of the file's bytes after its header.
    fn points(&self, body: &[u8]) -> Result<Vec<DVec3>, String> {
        let place = |name| {
            let real = |kind: &str| kind.starts_with("float") || kind.starts_with("double");
            self.numbers.iter().position(|&(known, kind, _)| known == name && real(kind))
        };
        let (Some(x), Some(y), Some(z)) = (place("x"), place("y"), place("z")) else {
            return Err("no x, y and z; expected float or double".to_owned());
        };
        let few = |found: usize| format!("{found} of {} points; expected all", self.count);
        if self.encoding == "ascii" {
            let text = std::str::from_utf8(body).map_err(|_| "not text; expected numbers".to_owned())?;
            let mut points = Vec::new();
            for line in text.lines().take(self.count) {
                let words: Vec<&str> = line.split_ascii_whitespace().collect();
                let number = |at: usize| words.get(at).and_then(|word| word.parse().ok());
                let [Some(x), Some(y), Some(z)] = [x, y, z].map(number) else { return Err(few(points.len())) };
                points.push(DVec3::new(x, y, z));
            }
            return if points.len() == self.count { Ok(points) } else { Err(few(points.len())) };
        }
        let little = match self.encoding {
            "binary_little_endian" => true,
            "binary_big_endian" => false,
            other => return Err(format!("format {other}; expected ascii or binary")),
        };
        let bytes = |numbers: &[(_, _, usize)]| numbers.iter().map(|(_, _, size)| size).sum::<usize>();
        let stride = bytes(&self.numbers);
        let found = body.len() / stride;
        if found < self.count {
            return Err(few(found));
        }
        let offset = |at: usize| (bytes(&self.numbers[..at]), self.numbers[at].2);
        let offsets = [x, y, z].map(offset);
        let point = |record: &[u8]| offsets.map(|(start, size)| number(&record[start..start + size], little));
        Ok(body.chunks_exact(stride).take(self.count).map(|record| DVec3::from_array(point(record))).collect())
    }
}

/// A number of 4 or 8 bytes.
fn number(bytes: &[u8], little: bool) -> f64 {
    let float = |bytes| f64::from(if little { f32::from_le_bytes(bytes) } else { f32::from_be_bytes(bytes) });
    let double = |bytes| if little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) };
    bytes.try_into().map(float).or_else(|_| bytes.try_into().map(double)).expect("4 or 8 bytes")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(format: &str, body: &[u8]) -> Vec<u8> {
        let head = format!(
            "ply\r\nformat {format} 1.0\ncomment 2 points\nelement vertex 2\nproperty uchar red\nproperty double x\n\
             property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n"
        );
        [head.as_bytes(), body].concat()
    }

    fn binary(little: bool) -> Vec<u8> {
        let point = |x: f64, y: f32, z: f32| match little {
            true => [&[255][..], &x.to_le_bytes(), &y.to_le_bytes(), &z.to_le_bytes()].concat(),
            false => [&[255][..], &x.to_be_bytes(), &y.to_be_bytes(), &z.to_be_bytes()].concat(),
        };
        [point(1.0, 2.0, 3.5), point(-4.0, 5.0, 6.0), vec![3, 0, 0]].concat()
    }

    #[test]
    fn text_and_binary_files_hold_equal_points() {
        let expected = vec![DVec3::new(1.0, 2.0, 3.5), DVec3::new(-4.0, 5.0, 6.0)];
        assert_eq!(ply_points(&file("ascii", b"255 1 2 3.5\n255 -4 5 6\n3 0 1 2\n")).unwrap(), expected);
        assert_eq!(ply_points(&file("binary_little_endian", &binary(true))).unwrap(), expected);
        assert_eq!(ply_points(&file("binary_big_endian", &binary(false))).unwrap(), expected);
    }

    #[test]
    fn damaged_file_is_an_error() {
        let whole = file("binary_little_endian", &binary(true));
        for keep in 0..whole.len() - 3 {
            let message = ply_points(&whole[..keep]).unwrap_err();
            assert!(message.contains("; expected "), "{message}");
        }
        for (from, to) in [("x", "u"), ("float y", "int y"), ("vertex", "face"), ("2\n", "two\n"), ("ascii", "zip")] {
            let text = String::from_utf8(file("ascii", b"255 1 2 3\n255 1 2 3\n")).unwrap().replacen(from, to, 1);
            let message = ply_points(text.as_bytes()).unwrap_err();
            assert!(message.contains("; expected "), "{from}: {message}");
        }
        assert!(ply_points(&file("ascii", b"255 1 2 3\n255 1 2\n")).unwrap_err().starts_with("1 of 2 points"));
    }
}
