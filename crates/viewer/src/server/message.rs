//! Messages of a client: JSON, validated field by field.

use liveview::Camera;
use liveview_scene::cameras::camera_from_json;
use serde_json::Value;

use crate::request::{ViewRequest, Viewpoint};

/// Largest message, bytes.
pub(crate) const MAX_BYTES: usize = 4096;

/// A message of a client.
#[derive(Debug)]
pub(crate) enum ClientMessage {
    View(ViewRequest),
    /// The client has shown a frame.
    Shown,
}

/// What clients may request.
#[derive(Debug)]
pub(crate) struct Limits<'a> {
    /// Cameras of the photos: a requested picture is no larger than these.
    pub(crate) views: Vec<&'a Camera>,
    /// Time steps; 1 for a scene of photos.
    pub(crate) steps: usize,
}

/// Parses a message; an error says what was expected.
pub(crate) fn parse(text: &str, limits: &Limits<'_>) -> Result<ClientMessage, String> {
    let message: Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
    let number = |key: &str| message[key].as_u64().ok_or_else(|| format!("{key}: expected a whole number"));
    let flag = |key: &str| message[key].as_bool().ok_or_else(|| format!("{key}: expected true or false"));
    if message.get("shown").is_some() {
        return number("shown").map(|_| ClientMessage::Shown);
    }
    if message.get("camera").is_none() {
        return Err("expected \"camera\" or \"shown\"".to_owned());
    }
    let (id, moving, depth) = (number("id")?, flag("moving")?, flag("depth")?);
    Ok(ClientMessage::View(ViewRequest { id, viewpoint: viewpoint(&message, limits)?, moving, depth }))
}

/// Reads `camera` and, for a rig, `step` (default: the first).
pub(crate) fn viewpoint(message: &Value, limits: &Limits<'_>) -> Result<Viewpoint, String> {
    let last = limits.steps - 1;
    let step = match message.get("step") {
        None => Some(0),
        Some(step) => step.as_u64().and_then(|step| usize::try_from(step).ok()).filter(|&step| step <= last),
    };
    let step = step.ok_or_else(|| format!("step: expected a time step from 0 to {last}"))?;
    Ok(Viewpoint { camera: camera(&message["camera"], &limits.views)?, step })
}

/// Reads a camera in the format of `render --pose`, no larger than the photos.
fn camera(entry: &Value, views: &[&Camera]) -> Result<Camera, String> {
    let camera = camera_from_json(entry, views)?;
    let max_side = views.iter().map(|view| view.width().max(view.height())).max().unwrap_or(0);
    if camera.width().max(camera.height()) > max_side {
        let (width, height) = (camera.width(), camera.height());
        return Err(format!("w, h: {width}x{height} is larger than the photos; expected sides of at most {max_side}"));
    }
    let max_pixels = views.iter().map(|view| view.size().pixels()).max().unwrap_or(0);
    if camera.size().pixels() > max_pixels {
        let (width, height) = (camera.width(), camera.height());
        return Err(format!("w, h: {width}x{height} is larger than the photos; expected at most {max_pixels} pixels"));
    }
    Ok(camera)
}

#[cfg(test)]
mod tests {
    use liveview::Intrinsics;
    use liveview::glam::{DMat3, DVec3};

    use super::*;

    #[test]
    fn invalid_message_error_names_the_field() {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let view = Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let limits = Limits { views: vec![&view], steps: 3 };
        let pose = r#""cam_from_world": [[1,0,0,0.5],[0,1,0,0],[0,0,1,0]]"#;
        let message = |camera: &str| format!(r#"{{"id": 3, "moving": true, "depth": false, "camera": {{{camera}}}}}"#);
        let Ok(ClientMessage::View(request)) = parse(&message(pose), &limits) else { panic!() };
        assert_eq!((request.id, request.moving, request.depth), (3, true, false));
        assert_eq!((request.viewpoint.camera.translation().x, request.viewpoint.step), (0.5, 0));
        let later = message(pose).replace("\"id\"", "\"step\": 2, \"id\"");
        let Ok(ClientMessage::View(request)) = parse(&later, &limits) else { panic!() };
        assert_eq!(request.viewpoint.step, 2);
        assert!(matches!(parse(r#"{"shown": 4}"#, &limits), Ok(ClientMessage::Shown)));
        for (text, word) in [
            ("", "not JSON"),
            (&"[".repeat(4000), "not JSON"),
            ("[]", "camera"),
            (r#"{"shown": -1}"#, "shown"),
            (r#"{"camera": {}}"#, "id"),
            (r#"{"camera": {}, "id": 1, "moving": 1}"#, "moving"),
            (&message(""), "cam_from_world"),
            (&message(&format!("{pose}, \"w\": 64, \"h\": 64")), "at most 3072 pixels"),
            (&message(&format!("{pose}, \"w\": 300, \"h\": 10")), "sides of at most 64"),
            (&message(&format!("{pose}, \"fl_x\": 1e999")), "not JSON"),
            (&message(&pose.replace("1,0,0", "2,0,0")), "rotation"),
            (&later.replace(": 2", ": 3"), "step: expected a time step from 0 to 2"),
            (&later.replace(": 2", ": -1"), "step"),
            (&later.replace(": 2", ": 1e300"), "step"),
        ] {
            let refused = parse(text, &limits).unwrap_err();
            assert!(refused.contains(word), "{word}: {refused}");
        }
    }
}
