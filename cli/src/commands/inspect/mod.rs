//! `liveview inspect`: how a scene is read, and which views and planes are skipped.

mod agreement;
mod exposure;
mod spread;

use std::fmt::Write;

use anyhow::{Result, bail};
use clap::Args;
use glam::{DMat3, DVec2, DVec3};
use liveview::geometry::parallax::{coverage, grid, parallax};
use liveview::geometry::{MeanPose, PlaneSweep, choose_views, distance, middle_camera};
use liveview::layers::uniform_disparities;
use liveview::scene::View;
use liveview::{Camera, LayerSpec, SceneViews, SynthesisError};
use liveview_common::args::numbers;
use liveview_common::args::scene::SceneArgs;
use liveview_common::console::{Output, advice, escaped, path_text};
use liveview_common::statistics::quantile;
use serde_json::{Value, json};
use spread::{largest_angle, nearest_distances};

const EXAMPLES: &str = "\
Examples:
  liveview inspect scene
  liveview inspect scene --target IMG_7.jpg --views 5 --layers planes:128
  liveview inspect scene --near 1.5 --far 40 --json
  liveview inspect scene --target IMG_7.jpg --exposure";

/// Parallax between neighbouring planes above which they are visible as steps, in pixels.
const MAX_STEP: f64 = 1.0;

/// Options of `liveview inspect`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct InspectArgs {
    /// View to use as the target, held out [default: the middle one]
    #[arg(long, value_name = "NAME")]
    target: Option<String>,
    /// Number of views to render it from
    #[arg(long, value_name = "V", default_value = "4", value_parser = numbers::count)]
    views: usize,
    /// Planes whose spacing to check: planes:D or list:…
    #[arg(long, value_name = "SPEC", default_value = "planes:64")]
    layers: LayerSpec,
    /// Print the exposure gains of these views; slow, since it searches the depth of the photos
    ///
    /// The factors by which surface layers multiply each colour channel of each photo; 1 also if
    /// two photos have too few points in common.
    #[arg(long)]
    exposure: bool,
    #[command(flatten)]
    scene: SceneArgs,
}

/// One part of the report: as text, and as JSON.
type Section = (String, Value);

pub(crate) fn run(args: &InspectArgs) -> Result<Output> {
    let photos = args.scene.open()?;
    let scene = photos.scene();
    let target = match &args.target {
        Some(name) => scene.view_index(name)?,
        None => middle_camera(&photos.all_cameras()),
    };
    let mut text =
        format!("scene      {}: {}\nposes      {}\n", scene.root.display(), scene.format, scene.format.conventions());
    let (section, views) = intrinsics(&scene.views);
    text += &section;
    let (section, rig) = rig(&scene.views);
    text += &section;
    let (section, mut target_json) = target_section(&photos, target, args)?;
    text += &section;
    if args.exposure && target_json["warning"].is_null() {
        let (section, gains) = exposure::gains(&photos, target, args.views)?;
        text += &section;
        gains.iter().enumerate().for_each(|(view, gains)| target_json["views"][view]["exposure_gains"] = json!(gains));
    }
    if target_json["warning"].is_null() {
        let (section, shares) = agreement::section(&args.scene, target, args.views);
        text += &section;
        [target_json["confirmed_share"], target_json["agreeing_share"]] = shares.map(|share| json!(share));
    }
    let scene = photos.scene();
    for note in &scene.notes {
        let _ = writeln!(text, "note       {}", escaped(note));
    }
    let json = json!({
        "scene": path_text(&scene.root), "format": scene.format.to_string(), "conventions": scene.format.conventions(),
        "views": views, "rig": rig, "target": target_json, "notes": scene.notes,
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
fn target_section(photos: &SceneViews, target: usize, args: &InspectArgs) -> Result<Section> {
    let View { name, camera, .. } = &photos.scene().views[target];
    let faces_away = |view: &&View| choose_views(&[&view.camera], camera, 1).is_err();
    let facing_away: Vec<&str> =
        photos.scene().views.iter().filter(faces_away).map(|view| view.name.as_str()).collect();
    let mut text = format!("\ntarget     {}, held out, from {} views\n", escaped(name), args.views);
    let mut json = json!({ "name": name, "facing_away": facing_away });
    if !facing_away.is_empty() {
        let names = escaped(&facing_away.join(", "));
        let _ = writeln!(text, "skipped    views that face more than 60 degrees away: {names}");
    }
    let views = match photos.choose(name, camera, &[target], args.views) {
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
    let disparities = match &args.layers {
        LayerSpec::Planes(count) => uniform_disparities(near, far, *count)?,
        LayerSpec::List(disparities) => disparities.clone(),
        other => bail!("--layers {other}: expected planes:D or list:…"),
    };
    let count = disparities.len();
    let sources: Vec<(&Camera, PlaneSweep)> =
        photos.cameras(&views).map(|view| (view, PlaneSweep::new(view, camera))).collect();
    let grid = grid(camera);
    let (table, rows, step) = spacing(photos, &views, &sources, &grid, &disparities, camera);
    text += &table;
    json["views"] = rows;
    let _ = writeln!(text, "planes     {count} from near to far: parallax between neighbours at most {step:.2} pixels");
    json["planes"] = json!({ "count": count, "largest_step_pixels": step });
    if step > MAX_STEP {
        let needed = (step / MAX_STEP * (count.max(2) - 1) as f64).ceil() + 1.0;
        let _ = writeln!(
            text,
            "warning    above {MAX_STEP} pixel, planes are visible as steps: use about planes:{needed}, or guided layers"
        );
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
