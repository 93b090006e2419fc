//! Messages of a client: JSON, checked field by field.

use liveview::Camera;
use liveview::geometry::camera_from_json;
use serde_json::Value;

use crate::wish::{Moment, Wish};

/// Most bytes of a message.
pub(crate) const MAX_BYTES: usize = 4096;

/// A message of a client.
#[derive(Debug)]
pub(crate) enum Request {
    Look(Wish),
    /// A frame is on the screen.
    Shown,
}

/// What a message may ask for.
#[derive(Debug)]
pub(crate) struct Range<'a> {
    pub(crate) views: Vec<&'a Camera>,
    /// Time steps; 1 of a scene.
    pub(crate) steps: usize,
}

/// What a message says; else what was expected.
pub(crate) fn parse(text: &str, range: &Range<'_>) -> Result<Request, String> {
    let message: Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
    let whole = |key: &str| message[key].as_u64().ok_or_else(|| format!("{key}: expected a whole number"));
    let flag = |key: &str| message[key].as_bool().ok_or_else(|| format!("{key}: expected true or false"));
    if message.get("shown").is_some() {
        return whole("shown").map(|_| Request::Shown);
    }
    if message.get("camera").is_none() {
        return Err("expected \"camera\" or \"shown\"".to_owned());
    }
    let (id, moving, depth) = (whole("id")?, flag("moving")?, flag("depth")?);
    Ok(Request::Look(Wish { id, at: moment(&message, range)?, moving, depth }))
}

/// `camera`, and of a rig `step`: the first if it is left out.
pub(crate) fn moment(message: &Value, range: &Range<'_>) -> Result<Moment, String> {
    let last = range.steps - 1;
    let step = match message.get("step") {
        None => Some(0),
        Some(step) => step.as_u64().and_then(|step| usize::try_from(step).ok()).filter(|&step| step <= last),
    };
    let step = step.ok_or_else(|| format!("step: expected a time step from 0 to {last}"))?;
    Ok(Moment { camera: camera(&message["camera"], &range.views)?, step })
}

/// A camera as `render --pose` reads it, no larger than the photos.
fn camera(entry: &Value, views: &[&Camera]) -> Result<Camera, String> {
    let camera = camera_from_json(entry, views)?;
    let most = views.iter().map(|view| view.size().pixels()).max().unwrap_or(0);
    if camera.size().pixels() > most {
        let (width, height) = (camera.width(), camera.height());
        return Err(format!("w, h: {width}x{height} is larger than the photos; expected at most {most} pixels"));
    }
    Ok(camera)
}

#[cfg(test)]
mod tests {
    use liveview::Intrinsics;
    use liveview::glam::{DMat3, DVec3};

    use super::*;

    #[test]
    fn what_is_wrong_is_named() {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let view = Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let range = Range { views: vec![&view], steps: 3 };
        let pose = r#""cam_from_world": [[1,0,0,0.5],[0,1,0,0],[0,0,1,0]]"#;
        let look = |camera: &str| format!(r#"{{"id": 3, "moving": true, "depth": false, "camera": {{{camera}}}}}"#);
        let Ok(Request::Look(wish)) = parse(&look(pose), &range) else { panic!() };
        assert_eq!((wish.id, wish.moving, wish.depth), (3, true, false));
        assert_eq!((wish.at.camera.translation().x, wish.at.step), (0.5, 0));
        let later = look(pose).replace("\"id\"", "\"step\": 2, \"id\"");
        let Ok(Request::Look(wish)) = parse(&later, &range) else { panic!() };
        assert_eq!(wish.at.step, 2);
        assert!(matches!(parse(r#"{"shown": 4}"#, &range), Ok(Request::Shown)));
        for (text, word) in [
            ("", "not JSON"),
            (&"[".repeat(4000), "not JSON"),
            ("[]", "camera"),
            (r#"{"shown": -1}"#, "shown"),
            (r#"{"camera": {}}"#, "id"),
            (r#"{"camera": {}, "id": 1, "moving": 1}"#, "moving"),
            (&look(""), "cam_from_world"),
            (&look(&format!("{pose}, \"w\": 640, \"h\": 480")), "at most 3072 pixels"),
            (&look(&format!("{pose}, \"fl_x\": 1e999")), "not JSON"),
            (&look(&pose.replace("1,0,0", "2,0,0")), "rotation"),
            (&later.replace(": 2", ": 3"), "step: expected a time step from 0 to 2"),
            (&later.replace(": 2", ": -1"), "step"),
            (&later.replace(": 2", ": 1e300"), "step"),
        ] {
            let refused = parse(text, &range).unwrap_err();
            assert!(refused.contains(word), "{word}: {refused}");
        }
    }
}
