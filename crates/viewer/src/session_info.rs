//! The first message to each client: the scene, its cameras, and the engine.

use liveview::{Camera, Intrinsics, Scene};
use serde_json::{Value, json};

/// The time steps of a rig.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VideoInfo {
    pub(crate) steps: usize,
    /// Time steps per second.
    pub(crate) rate: f64,
}

/// What a client needs to know of the session.
#[derive(Debug)]
pub(crate) struct SessionInfo<'a> {
    pub(crate) scene: &'a Scene,
    /// Execution provider and precision, such as `cpu, f32`.
    pub(crate) engine: &'a str,
    pub(crate) threads: usize,
    /// Indices of the held-out views.
    pub(crate) held_out: &'a [usize],
    /// Index of the view near which clients start.
    pub(crate) start_view: usize,
    /// The nearest depth, scene units.
    pub(crate) near: Option<f64>,
    /// `None` for a scene of photos.
    pub(crate) video: Option<VideoInfo>,
}

impl SessionInfo<'_> {
    pub(crate) fn to_json(&self) -> Value {
        let Self { scene, engine, threads, held_out, start_view, near, video } = *self;
        let views = scene.views.iter().enumerate().map(|(index, view)| {
            json!({ "name": view.name, "camera": camera_json(&view.camera), "held_out": held_out.contains(&index) })
        });
        let folder = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
        json!({
            "scene": folder.file_name().unwrap_or_default().to_string_lossy(),
            "engine": engine,
            "threads": threads,
            "views": views.collect::<Vec<_>>(),
            "start_view": start_view,
            "near": near,
            "video": video.map(|video| json!({ "steps": video.steps, "rate": video.rate })),
        })
    }
}

/// A camera in the format that `render --pose` reads.
fn camera_json(camera: &Camera) -> Value {
    let (rotation, translation) = (camera.rotation(), camera.translation());
    let row = |row: usize| [rotation.row(row).x, rotation.row(row).y, rotation.row(row).z, translation[row]];
    let Intrinsics { fx, fy, cx, cy, .. } = camera.intrinsics();
    json!({
        "cam_from_world": [row(0), row(1), row(2)],
        "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": camera.width(), "h": camera.height(),
    })
}
