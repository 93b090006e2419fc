//! Messages of a client: JSON, checked field by field.

use liveview::Camera;
use liveview::geometry::camera_from_json;
use serde_json::Value;

use super::desk::Wish;

/// Most bytes of a message.
pub(super) const MAX_BYTES: usize = 4096;

/// A message of a client.
#[derive(Debug)]
pub(super) enum Request {
    Look(Wish),
    /// A frame is on the screen.
    Shown,
}

/// What a message says; else what was expected.
pub(super) fn parse(text: &str, views: &[&Camera]) -> Result<Request, String> {
    let message: Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
    let whole = |key: &str| message[key].as_u64().ok_or_else(|| format!("{key}: expected a whole number"));
    let flag = |key: &str| message[key].as_bool().ok_or_else(|| format!("{key}: expected true or false"));
    if message.get("shown").is_some() {
        return whole("shown").map(|_| Request::Shown);
    }
    let Some(entry) = message.get("camera") else { return Err("expected \"camera\" or \"shown\"".to_owned()) };
    let (id, moving, depth) = (whole("id")?, flag("moving")?, flag("depth")?);
    Ok(Request::Look(Wish { id, camera: camera(entry, views)?, moving, depth }))
}

/// A camera as `render --pose` reads it, no larger than the photos.
pub(super) fn camera(entry: &Value, views: &[&Camera]) -> Result<Camera, String> {
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
        let pose = r#""cam_from_world": [[1,0,0,0.5],[0,1,0,0],[0,0,1,0]]"#;
        let look = |camera: &str| format!(r#"{{"id": 3, "moving": true, "depth": false, "camera": {{{camera}}}}}"#);
        let Ok(Request::Look(wish)) = parse(&look(pose), &[&view]) else { panic!() };
        assert_eq!((wish.id, wish.moving, wish.depth, wish.camera.translation().x), (3, true, false, 0.5));
        assert!(matches!(parse(r#"{"shown": 4}"#, &[&view]), Ok(Request::Shown)));
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
        ] {
            let refused = parse(text, &[&view]).unwrap_err();
            assert!(refused.contains(word), "{word}: {refused}");
        }
    }
}
