//! How a scene is read, and which views and planes are skipped.

use std::fmt::Write;

use anyhow::{Result, bail};
use glam::{DMat3, DVec2, DVec3};
use liveview::Camera;
use liveview::geometry::{PlaneSweep, distance, facing_alike, middle_camera};
use liveview::layers::uniform_disparities;
use liveview_scene::View;
use liveview_scene::cameras::MeanPose;
use liveview_surface::parallax::{coverage, grid, parallax};
use liveview_synthesizer::agreement;
use liveview_synthesizer::{LayerSpec, SceneViews, SynthesisError};
use serde_json::{Value, json};

use super::InspectArgs;
use crate::args::SceneArgs;
use crate::commands::sweep::quantile;
use crate::console::{Output, advice, escaped, full_text, path_text};

/// Parallax between neighbouring planes above which they are visible as steps, in pixels.
const MAX_STEP: f64 = 1.0;
/// Planes whose spacing is checked by default.
const LAYERS: LayerSpec = LayerSpec::Planes(64);
/// Number of views by default.
const VIEWS: usize = 4;
/// Width of the copies of the photos whose agreement is checked, pixels.
const SMALL_WIDTH: usize = 200;

/// One part of the report: as text, and as JSON.
type Section = (String, Value);

/// The report on a scene.
pub(super) fn report(args: &InspectArgs, photos: &SceneViews) -> Result<Output> {
    let views = args.model.views.unwrap_or(VIEWS);
    let scene = photos.scene();
    let target = match &args.target {
        Some(name) => scene.view_index(name)?,
        None => middle_camera(&photos.all_cameras()),
    };
    let mut text =
        format!("scene      {}: {}\nposes      {}\n", scene.root.display(), scene.format, scene.format.conventions());
    let (section, views_json) = intrinsics(&scene.views);
    text += &section;
    let (section, rig) = rig(&scene.views);
    text += &section;
    if let Some(error) = scene.reprojection_error {
        let _ =
            writeln!(text, "points     tracked points lie {error:.2} pixels from where the poses show them (median)");
    }
    let (section, mut target_json) = target_section(photos, target, views, args.layers.as_ref())?;
    text += &section;
    if target_json["warning"].is_null() {
        let (section, shares) = agreement(&args.scene, photos, target, views).unwrap_or_else(|error| {
            let error = escaped(&full_text(&error));
            (format!("warning    cannot check whether the photos agree: {error}\n"), [None; 2])
        });
        text += &section;
        [target_json["confirmed_share"], target_json["agreeing_share"]] = shares.map(|share| json!(share));
    }
    let scene = photos.scene();
    for note in &scene.notes {
        let _ = writeln!(text, "note       {}", escaped(note));
    }
    let json = json!({
        "scene": path_text(&scene.root), "format": scene.format.to_string(), "conventions": scene.format.conventions(),
        "views": views_json, "rig": rig, "target": target_json, "notes": scene.notes,
        "reprojection_error": scene.reprojection_error,
    });
    Ok(Output { text, json })
}

/// Sizes, intrinsics and fields of view.
fn intrinsics(views: &[View]) -> Section {
    let range = |of: &dyn Fn(&Camera) -> f64| {
        let values = || views.iter().map(|view| of(&view.camera));
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let span = |(low, high): (f64, f64)| {
        if high - low < 0.05 { format!("{low:.1}") } else { format!("{low:.1} to {high:.1}") }
    };
    let integers = |(low, high): (f64, f64)| if low == high { format!("{low}") } else { format!("{low} to {high}") };
    let (width, height) = (range(&|c| c.width() as f64), range(&|c| c.height() as f64));
    let k: [(&str, (f64, f64)); 4] = [
        ("fx", range(&|c| c.intrinsics().fx)),
        ("fy", range(&|c| c.intrinsics().fy)),
        ("cx", range(&|c| c.intrinsics().cx)),
        ("cy", range(&|c| c.intrinsics().cy)),
    ];
    let field = range(&|c| 2.0 * (0.5 * c.width() as f64 / c.intrinsics().fx).atan().to_degrees());
    let all = k.iter().map(|&(name, values)| format!("{name} {}", span(values))).collect::<Vec<_>>().join(", ");
    let text = format!(
        "views      {}, {} x {} pixels\nintrinsics {all} pixels; horizontal field of view {} degrees\n",
        views.len(),
        integers(width),
        integers(height),
        span(field)
    );
    let intrinsics: serde_json::Map<_, _> =
        k.into_iter().map(|(name, values)| (name.to_owned(), json!(values))).collect();
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    (text, json!({ "count": views.len(), "names": names, "width": width, "height": height, "intrinsics": intrinsics }))
}

/// Extent, baselines and angles of the rig.
fn rig(views: &[View]) -> Section {
    let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
    let axes = MeanPose::new(&cameras).map_or(DMat3::IDENTITY, |rig| rig.rotation);
    let centres: Vec<DVec3> = cameras.iter().map(|camera| axes * camera.centre()).collect();
    let low = centres.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = centres.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let mut nearest = nearest_distances(&cameras.iter().map(|camera| camera.centre()).collect::<Vec<_>>());
    let [min, median, max] = [0.0, 0.5, 1.0].map(|fraction| quantile(&mut nearest, fraction));
    let forward: Vec<DVec3> = cameras.iter().map(|camera| camera.forward()).collect();
    let angle = largest_angle(&forward).to_degrees();
    let DVec3 { x, y, z } = high - low;
    let baseline = match views {
        [_] => "none: a single view".to_owned(),
        _ => format!("{median:.4} to the nearest view (median; {min:.4} to {max:.4})"),
    };
    let text = format!(
        "rig        {x:.4} across, {y:.4} down, {z:.4} forward, in scene units; angles of up to {angle:.1} degrees\n\
         baseline   {baseline}\n"
    );
    let baseline = json!({ "min": min, "median": median, "max": max });
    (text, json!({ "extent": [x, y, z], "baseline": baseline, "largest_angle_degrees": angle }))
}

/// The target, the views it would be rendered from, and the planes that no view covers.
fn target_section(photos: &SceneViews, target: usize, count: usize, layers: Option<&LayerSpec>) -> Result<Section> {
    let View { name, camera, .. } = &photos.scene().views[target];
    let faces_away = |view: &&View| facing_alike(&[&view.camera], camera).is_empty();
    let facing_away: Vec<&str> =
        photos.scene().views.iter().filter(faces_away).map(|view| view.name.as_str()).collect();
    let mut text = format!("\ntarget     {}, held out, from {count} views\n", escaped(name));
    let mut json = json!({ "name": name, "facing_away": facing_away });
    if !facing_away.is_empty() {
        let names = escaped(&facing_away.join(", "));
        let _ = writeln!(text, "skipped    views that face more than 60 degrees away: {names}");
    }
    let views = match photos.choose(name, camera, &[target], count, &[]) {
        Ok(views) => views,
        Err(error) => {
            let _ = writeln!(text, "warning    cannot be rendered: {}", escaped(&error.to_string()));
            json["warning"] = json!(error.to_string());
            return Ok((text, json));
        }
    };
    let (near, far) = match photos.depth_range(&views, &[target]) {
        Ok(range) => range,
        // An unknown range is reported; an invalid one is an error.
        Err(error @ SynthesisError::Layers(_)) => return Err(error.into()),
        Err(error) => {
            let error = advice(&error).map_or_else(|| error.to_string(), |advice| format!("{error}. {advice}"));
            let _ = writeln!(text, "views      {}\nwarning    {error}", escaped(&photos.names(&views).join(", ")));
            json["views"] = json!(photos.names(&views));
            json["warning"] = json!(error);
            return Ok((text, json));
        }
    };
    let source = match photos.given_depth() {
        _ if photos.has_found_depth() => "found from the photos",
        (Some(_), Some(_)) => "from --near and --far",
        (None, None) => "from the scene: the extremes of these views",
        (Some(_), None) => "from --near and the scene",
        (None, Some(_)) => "from the scene and --far",
    };
    let _ = writeln!(text, "depth      {near:.4} to {far:.4} scene units, {source}");
    json["near"] = json!(near);
    json["far"] = json!(far);
    let asked = layers.is_some();
    let disparities = match layers.unwrap_or(&LAYERS) {
        LayerSpec::Planes(count) => uniform_disparities(near, far, *count)?,
        LayerSpec::List(disparities) => disparities.clone(),
        other => bail!("--layers {other}: expected planes:D or list:…"),
    };
    let planes = disparities.len();
    let sources: Vec<(&Camera, PlaneSweep)> =
        photos.cameras(&views).map(|view| (view, PlaneSweep::new(view, camera))).collect();
    let grid = grid(camera);
    let (table, rows, step) = spacing(photos, &views, &sources, &grid, &disparities, camera);
    text += &table;
    json["views"] = rows;
    let _ =
        writeln!(text, "planes     {planes} from near to far: parallax between neighbours at most {step:.2} pixels");
    json["planes"] = json!({ "count": planes, "largest_step_pixels": step });
    if asked && step > MAX_STEP {
        let needed = (step / MAX_STEP * (planes.max(2) - 1) as f64).ceil() + 1.0;
        let _ =
            writeln!(text, "warning    above {MAX_STEP} pixel, planes are visible as steps: use about planes:{needed}");
    }
    let uncovered: Vec<usize> =
        (0..disparities.len()).filter(|&k| coverage(&sources, &grid, disparities[k]) == 0.0).collect();
    if !uncovered.is_empty() {
        let _ = writeln!(text, "skipped    planes that no view covers (0 is the nearest): {uncovered:?}");
    }
    json["planes"]["uncovered"] = json!(uncovered);
    Ok((text, json))
}

/// A table with a row for each view and one for all, as text and JSON, and the largest parallax
/// between neighbouring planes in pixels.
fn spacing(
    photos: &SceneViews,
    views: &[usize],
    sources: &[(&Camera, PlaneSweep)],
    grid: &[DVec2],
    disparities: &[f64],
    target: &Camera,
) -> (String, Value, f64) {
    let (nearest, farthest) = (disparities[0], disparities[disparities.len() - 1]);
    let depths = [nearest, 0.5 * (nearest + farthest), farthest];
    let shares = |of: &[(&Camera, PlaneSweep)]| depths.map(|disparity| 100.0 * coverage(of, grid, disparity));
    let cells = |shares: [f64; 3]| shares.map(|share| format!("{share:4.0} %")).join(" ");
    let width = views.iter().map(|&view| photos.scene().views[view].name.chars().count()).max().unwrap_or(0).max(8);
    let mut text =
        format!("\n           {:width$}  distance  parallax      step  covered: near, middle, far\n", "view");
    let mut rows = Vec::new();
    let mut largest_step: f64 = 0.0;
    for (&view, (camera, sweep)) in views.iter().zip(sources) {
        let largest_parallax = |pair: (f64, f64)| {
            grid.iter().filter_map(move |&pixel| parallax(camera, sweep, pixel, pair)).fold(0.0, f64::max)
        };
        let total = largest_parallax((nearest, farthest));
        let step = disparities.windows(2).map(|pair| largest_parallax((pair[0], pair[1]))).fold(0.0, f64::max);
        largest_step = largest_step.max(step);
        let (name, distance) = (&photos.scene().views[view].name, distance(camera, target));
        let shares = shares(&[(camera, *sweep)]);
        let _ = writeln!(
            text,
            "           {:width$}  {distance:8.4}  {total:5.1} px  {step:5.2} px  {}",
            escaped(name),
            cells(shares)
        );
        rows.push(json!({
            "name": name, "distance": distance, "parallax_pixels": total, "step_pixels": step, "covered_percent": shares,
        }));
    }
    let _ = writeln!(text, "           {:width$}  {:28}  {}\n", "any view", "", cells(shares(sources)));
    (text, Value::Array(rows), largest_step)
}

/// Whether the photos agree around a target that is rendered from so many views, as text.
/// With it the share of the photos' depth that other photos confirm, and the share of the pixels on which they agree.
fn agreement(args: &SceneArgs, photos: &SceneViews, target: usize, views: usize) -> Result<(String, [Option<f64>; 2])> {
    let View { name, camera, .. } = &photos.scene().views[target];
    let (near, far) = photos.depth_range(&photos.choose(name, camera, &[target], views, &[])?, &[target])?;
    let small = args.open_at(Some(SMALL_WIDTH), (Some(near), Some(far)))?;
    let (surface, agreeing) = agreement::of_view(&small, target, views)?;
    let confirmed = surface.map(|surface| surface.confirmed_share);
    let percent = |share: Option<f64>| share.map_or_else(|| "-".to_owned(), |share| format!("{:.0} %", 100.0 * share));
    let mut text = format!(
        "agreement  the photos agree on {} of the pixels, and confirm {} of each other's depth\n",
        percent(agreeing),
        percent(confirmed)
    );
    if let Some(warning) = agreeing.and_then(agreement::warning) {
        let _ = writeln!(text, "warning    {warning}");
    }
    Ok((text, [confirmed, agreeing]))
}

/// Cameras, evenly spread in their order, that are compared with all others.
const COMPARED: usize = 1000;

fn compared(all: &[DVec3]) -> impl Iterator<Item = (usize, DVec3)> {
    all.iter().copied().enumerate().step_by(all.len().div_ceil(COMPARED).max(1))
}

/// Distance from each compared point to its nearest neighbour; empty for a single point.
fn nearest_distances(points: &[DVec3]) -> Vec<f64> {
    let nearest = |(index, point): (usize, DVec3)| {
        let others = points.iter().enumerate().filter(|&(other, _)| other != index);
        others.map(|(_, other)| point.distance(*other)).fold(f64::INFINITY, f64::min)
    };
    compared(points).map(nearest).filter(|distance| distance.is_finite()).collect()
}

/// Largest angle of a compared unit vector to another, in radians; 0 for a single one.
fn largest_angle(directions: &[DVec3]) -> f64 {
    let cosines = compared(directions).flat_map(|(_, a)| directions.iter().map(move |b| a.dot(*b)));
    cosines.fold(1.0, f64::min).clamp(-1.0, 1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_angles_are_those_of_all_pairs() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 3.0)];
        assert_eq!(nearest_distances(&corners), [1.0, 1.0, 1.0, 10.0_f64.sqrt()]);
        assert_eq!((nearest_distances(&corners[..1]), largest_angle(&[DVec3::X])), (vec![], 0.0));
        assert!((largest_angle(&[DVec3::X, DVec3::Y, -DVec3::X]) - std::f64::consts::PI).abs() < 1e-9);
    }

    /// All pairs would be ten thousand million distances.
    #[test]
    fn a_hundred_thousand_cameras_take_little_time() {
        let points: Vec<DVec3> = (0..100_000).map(|k| DVec3::new((k % 100) as f64, (k / 100) as f64, 1.0)).collect();
        assert!(nearest_distances(&points).iter().all(|&distance| distance == 1.0));
        let ahead: Vec<DVec3> = points.iter().map(|point| point.normalize()).collect();
        assert!(largest_angle(&ahead) > 0.1);
    }
}
