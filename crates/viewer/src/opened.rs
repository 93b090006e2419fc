//! Opens a scene or a rig for the viewer.

use std::sync::Arc;

use anyhow::{Result, bail};
use liveview::geometry::middle_camera;
use liveview::network::RunEnd;
use liveview::{Camera, Scene, Targets};
use liveview_common::console::{print_message, print_notes};
use liveview_common::job::Job;
use liveview_live::rig::Rig;

use crate::options::ViewArgs;
use crate::renderer::{Photos, Source, Video};
use crate::request_queue::RequestQueue;
use crate::session_info::{EngineInfo, VideoInfo};

/// A source of pictures, and what the session is described by.
pub(crate) struct Opened {
    pub(crate) source: Box<dyn Source>,
    pub(crate) engine: EngineInfo,
    /// Handles that end runs of the networks.
    pub(crate) runs: Vec<RunEnd>,
    /// Indices of the held-out views.
    pub(crate) held_out: Vec<usize>,
    /// Index of the view near which clients start.
    pub(crate) start_view: usize,
    /// The nearest depth, scene units.
    pub(crate) near: Option<f64>,
    /// The time steps of a rig.
    pub(crate) video: Option<VideoInfo>,
}

/// Opens the folder of the options.
///
/// # Errors
///
/// It cannot be opened, or no picture can be rendered at the first viewpoint: reported now rather than to each client.
pub(crate) fn open(args: &ViewArgs, queue: &Arc<RequestQueue>) -> Result<Opened> {
    match Rig::find(&args.scene)? {
        Some(rig) => open_rig(args, rig),
        None => open_photos(args, queue),
    }
}

fn open_photos(args: &ViewArgs, queue: &Arc<RequestQueue>) -> Result<Opened> {
    if args.fps.is_some() {
        let folder = args.scene.folder().display();
        bail!(
            "--fps: {folder} is a scene of photos; --fps is for a rig, in which each camera has a folder of frames or a video"
        );
    }
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    let held_out = args.held_out(photos.scene())?;
    let job = Job::open(photos, &args.layers, &args.model)?;
    let start_view = start_view(job.scene(), &held_out)?;
    let camera = job.scene().views[start_view].camera.clone();
    let targets = Targets { held_out: held_out.clone(), ..Targets::cameras(vec![camera.clone()]) };
    job.synthesizer.shots(targets)?;
    let runs = job.synthesizer.renderer().network().run_end().into_iter().collect();
    let engine = EngineInfo::new(&job.model);
    let photos = Photos::new(job, held_out.clone(), &camera, Arc::clone(queue))?;
    let near = photos.near();
    Ok(Opened { source: Box::new(photos), engine, runs, held_out, start_view, near, video: None })
}

fn open_rig(args: &ViewArgs, rig: Rig) -> Result<Opened> {
    let scene = rig.views.scene();
    print_notes(&scene.notes);
    for option in args.layers.unused_for_video() {
        print_message("note", format_args!("{option}: not used for the video of a rig"));
    }
    let held_out = args.held_out(scene)?;
    let start_view = start_view(scene, &held_out)?;
    let camera = scene.views[start_view].camera.clone();
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let steps = rig.steps(&free)?;
    let rate = args.fps.map_or_else(|| rig.rate(), Ok)?.per_second();
    let (video, model, runs) = Video::open(rig, free, &args.layers, &args.model)?;
    video.cameras_for(&camera)?;
    Ok(Opened {
        near: Some(video.near()),
        source: Box::new(video),
        engine: EngineInfo::new(&model),
        runs,
        held_out,
        start_view,
        video: Some(VideoInfo { steps, rate }),
    })
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
