//! The depth range of a `transforms.json` from points: those of its `ply_file_path`, or those of a
//! COLMAP model in the folder, which nerfstudio keeps in `colmap/sparse/0`.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;
use serde_json::Value;

use super::colmap::{self, Seen};
use super::ply;
use crate::pose_file::{read, safe_name};
use crate::{DeclaredView, DeclaredViews};

/// Points that are looked at: more would not change the percentiles.
const MAX_POINTS: usize = 8192;

/// Largest difference of a model's poses from those of the views, as a share of their extent.
const POSE_TOLERANCE: f64 = 0.05;

/// For each view its range of depths, in scene units, if it has one.
type Ranges = Vec<Option<(f64, f64)>>;

/// Sets the depth range of views that have none, and adds a note on where it is from.
pub(super) fn fill(root: &Path, path: &Path, file: &Value, found: &mut DeclaredViews) {
    if found.views.iter().all(|view| view.depth_range.is_some()) {
        return;
    }
    let mut sources: Vec<(String, Result<Ranges, String>)> = Vec::new();
    if let Some(name) = file.get("ply_file_path").and_then(Value::as_str) {
        let bytes = safe_name(path, name).and_then(|name| read(&root.join(name))).map_err(|error| error.to_string());
        let points = bytes.and_then(|bytes| ply::points(&bytes));
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
