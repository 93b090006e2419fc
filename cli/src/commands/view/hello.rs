//! What a client is told first: the scene, its cameras, and what renders it.

use liveview::{Camera, Intrinsics};
use serde_json::{Value, json};

use crate::job::Job;

/// The first message to each client.
pub(super) fn hello(job: &Job, held_out: &[usize], middle: usize) -> Value {
    let scene = job.scene();
    let views = scene.views.iter().enumerate().map(|(index, view)| {
        json!({ "name": view.name, "camera": camera(&view.camera), "held_out": held_out.contains(&index) })
    });
    let folder = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    json!({
        "scene": folder.file_name().unwrap_or_default().to_string_lossy(),
        "engine": job.model.engine(),
        "threads": job.model.threads,
        "views": views.collect::<Vec<_>>(),
        "middle": middle,
    })
}

/// A camera as `render --pose` reads it.
fn camera(camera: &Camera) -> Value {
    let (rotation, translation) = (camera.rotation(), camera.translation());
    let row = |row: usize| [rotation.row(row).x, rotation.row(row).y, rotation.row(row).z, translation[row]];
    let Intrinsics { fx, fy, cx, cy, .. } = camera.intrinsics();
    json!({
        "cam_from_world": [row(0), row(1), row(2)],
        "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": camera.width(), "h": camera.height(),
    })
}
