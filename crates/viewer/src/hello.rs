//! What a client is told first: the scene, its cameras, and what renders it.

use liveview::{Camera, Intrinsics, Scene};
use liveview_common::args::model_info::ModelInfo;
use serde_json::{Value, json};

/// What computes.
#[derive(Debug)]
pub(crate) struct Engine {
    name: String,
    threads: usize,
}

impl Engine {
    pub(crate) fn of(model: &ModelInfo) -> Self {
        Self { name: model.engine(), threads: model.threads }
    }
}

/// The time steps of a rig.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Playable {
    pub(crate) steps: usize,
    /// Per second.
    pub(crate) rate: f64,
}

/// The first message to each client. `middle`: the view that it begins near; `near`: the nearest depth, scene units.
pub(crate) fn hello(
    scene: &Scene,
    engine: &Engine,
    held_out: &[usize],
    middle: usize,
    near: Option<f64>,
    video: Option<Playable>,
) -> Value {
    let views = scene.views.iter().enumerate().map(|(index, view)| {
        json!({ "name": view.name, "camera": camera(&view.camera), "held_out": held_out.contains(&index) })
    });
    let folder = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    json!({
        "scene": folder.file_name().unwrap_or_default().to_string_lossy(),
        "engine": engine.name,
        "threads": engine.threads,
        "views": views.collect::<Vec<_>>(),
        "middle": middle,
        "near": near,
        "video": video.map(|video| json!({ "steps": video.steps, "rate": video.rate })),
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
