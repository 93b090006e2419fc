//! Metashape's "Export Cameras", an XML file: for each camera `transform`, 4×4 world from camera with OpenCV's axes, and a
//! sensor: f in pixels, cx and cy from the middle, b1 and b2 (affinity, skew), and Brown's distortion, of which p1 and
//! p2 are OpenCV's p2 and p1.

use glam::{DMat3, DMat4};
use roxmltree::Document;

use crate::photos::PhotoLookup;
use crate::scene_file::text;
use crate::view::seen_from;
use crate::{DeclaredView, DeclaredViews, Distortion, SceneError, SceneOptions};
use liveview::geometry::{Intrinsics, Size};

pub(super) fn views(bytes: &[u8], _: &SceneOptions, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    let wrong = |what: String| SceneError::malformed(path, what, "the cameras that Metashape exports");
    let text = text(path, bytes)?;
    let file = Document::parse(&text).map_err(|error| wrong(error.to_string()))?;
    let named = |name: &'static str| file.descendants().filter(move |node| node.has_tag_name(name));
    let mut unaligned = 0;
    for camera in named("camera") {
        let label = camera.attribute("label").unwrap_or_default();
        let Some(matrix) = camera.children().find(|node| node.has_tag_name("transform")) else {
            unaligned += 1;
            continue;
        };
        let Some(photo) = lookup.find(label)? else { continue };
        let numbers = matrix.text().unwrap_or_default().split_whitespace().map(str::parse);
        let matrix: Option<[f64; 16]> = numbers.collect::<Result<Vec<_>, _>>().ok().and_then(|all| all.try_into().ok());
        let matrix = DMat4::from_cols_array(&matrix.ok_or_else(|| wrong(format!("transform of {label}")))?).transpose();
        let sensor = named("sensor").find(|sensor| sensor.attribute("id") == camera.attribute("sensor_id"));
        let lens = sensor.and_then(|sensor| sensor.children().rfind(|node| node.has_tag_name("calibration")));
        let lens = lens.ok_or_else(|| wrong(format!("no calibration of {label}")))?;
        let field = |name: &str| lens.children().find(|node| node.has_tag_name(name));
        let number = |name: &str| {
            let text = field(name).and_then(|node| node.text());
            text.map_or(Ok(0.0), |text| text.trim().parse().map_err(|_| wrong(format!("{name} is {text}"))))
        };
        let side = |name: &str| field("resolution").and_then(|size| size.attribute(name)?.parse().ok());
        let (Some(width), Some(height)) = (side("width"), side("height")) else {
            return Err(wrong(format!("no resolution of the sensor of {label}")));
        };
        let kind = lens.attribute("type").unwrap_or("frame");
        let (f, fisheye) = (number("f")?, kind == "fisheye");
        let (k4, p) = (number("k4")?, [number("p2")?, number("p1")?]);
        if !["frame", "fisheye"].contains(&kind) || !fisheye && k4 != 0.0 || fisheye && p != [0.0; 2] {
            let hint = "undistort the photos (Export, Undistort Photos), or fit a frame camera without k4";
            return Err(SceneError::unsupported(path, format!("the lens of {label}, {kind},"), hint));
        }
        let (cx, cy) = (0.5 * width as f64 + number("cx")?, 0.5 * height as f64 + number("cy")?);
        let intrinsics = Intrinsics { fx: f + number("b1")?, fy: f, cx, cy, skew: number("b2")? };
        let k = [number("k1")?, number("k2")?, number("k3")?, k4, 0.0, 0.0];
        let pose = seen_from(DMat3::from_mat4(matrix), matrix.w_axis.truncate());
        let view = DeclaredView::new(photo, (intrinsics, Size::new(width, height)), pose);
        lookup.views.push(DeclaredView { distortion: Distortion { fisheye, division: false, k, p }, ..view });
    }
    if unaligned > 0 {
        lookup.note(format!("{unaligned} photos were not aligned by Metashape, skipped"));
    }
    lookup.finish()
}
