//! Opens a scene or a rig for the viewer, and describes it to each client.

use std::sync::Arc;

use anyhow::{Result, bail};
use liveview::geometry::middle_camera;
use liveview::{Camera, Intrinsics};
use liveview_synthesizer::{Scene, Synthesizer, Targets};
use serde_json::{Value, json};

use crate::renderer::{Photos, Source, Video};
use crate::requests::RequestQueue;
use crate::{RigVideo, Shown, ViewSettings};

/// A source of pictures, and what the session is described by.
pub(crate) struct Opened {
    pub(crate) source: Box<dyn Source>,
    /// Index of the view near which clients start.
    pub(crate) start_view: usize,
    /// The nearest depth, scene units.
    pub(crate) near: Option<f64>,
    /// The time steps of a rig.
    pub(crate) video: Option<VideoInfo>,
}

/// Opens what is shown.
///
/// # Errors
///
/// No picture can be rendered at the first viewpoint: reported now rather than to each client.
pub(crate) fn open(shown: Shown, settings: &ViewSettings, queue: &Arc<RequestQueue>) -> Result<Opened> {
    match shown {
        Shown::Photos(synthesizer) => open_photos(*synthesizer, settings, queue),
        Shown::Video(video) => open_rig(*video, settings),
    }
}

fn open_photos(synthesizer: Synthesizer, settings: &ViewSettings, queue: &Arc<RequestQueue>) -> Result<Opened> {
    let held_out = &settings.held_out;
    let start_view = start_view(synthesizer.scene(), held_out)?;
    let camera = synthesizer.scene().views[start_view].camera.clone();
    let targets = Targets { held_out: held_out.clone(), ..Targets::cameras(vec![camera.clone()]) };
    synthesizer.shots(targets)?;
    let photos = Photos::new(synthesizer, settings, &camera, Arc::clone(queue))?;
    let near = photos.near();
    Ok(Opened { source: Box::new(photos), start_view, near, video: None })
}

fn open_rig(video: RigVideo, settings: &ViewSettings) -> Result<Opened> {
    let (scene, held_out) = (video.rig.views.scene(), &settings.held_out);
    let start_view = start_view(scene, held_out)?;
    let camera = scene.views[start_view].camera.clone();
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let info = VideoInfo { steps: video.rig.steps(&free)?, rate: video.rate };
    let video = Video::open(video, free)?;
    video.cameras_for(&camera)?;
    Ok(Opened { near: Some(video.near()), source: Box::new(video), start_view, video: Some(info) })
}

/// The view in the middle of those that are not held out.
fn start_view(scene: &Scene, held_out: &[usize]) -> Result<usize> {
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let cameras: Vec<&Camera> = free.iter().map(|&view| &scene.views[view].camera).collect();
    if cameras.is_empty() {
        bail!("every photo is held out; expected some to render from");
    }
    Ok(free[middle_camera(&cameras)])
}

/// The time steps of a rig.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VideoInfo {
    pub(crate) steps: usize,
    /// Time steps per second.
    pub(crate) rate: f64,
}

/// The first message to each client: the scene, its cameras, and the engine.
pub(crate) fn session_info(opened: &Opened, settings: &ViewSettings) -> Value {
    let (scene, video) = (opened.source.scene(), opened.video);
    let views = scene.views.iter().enumerate().map(|(index, view)| {
        let held_out = settings.held_out.contains(&index);
        json!({ "name": view.name, "camera": camera_json(&view.camera), "held_out": held_out })
    });
    let folder = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    json!({
        "scene": folder.file_name().unwrap_or_default().to_string_lossy(),
        "engine": settings.engine,
        "threads": settings.threads,
        "views": views.collect::<Vec<_>>(),
        "start_view": opened.start_view,
        "near": opened.near,
        "video": video.map(|video| json!({ "steps": video.steps, "rate": video.rate })),
    })
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
