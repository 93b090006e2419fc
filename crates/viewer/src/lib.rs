//! A scene, or the video of a rig, in the browser; the mouse, a finger or keys move the viewpoint.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

mod renderer;
mod requests;
mod server;

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Result, bail};
use liveview::geometry::middle_camera;
use liveview::{Camera, Intrinsics};
use liveview_live::video::RigSettings;
use liveview_synthesizer::{Scene, Synthesizer, Targets};
use serde_json::{Value, json};

use renderer::{Photos, Source, Video, ViewRenderer};
use requests::{FileError, FileRequest, Message, RequestQueue, Task, Waiting};
use server::{App, Guard, Server, listen, reachable};

/// Interval at which an interrupt is looked for.
const INTERRUPT_POLL: Duration = Duration::from_millis(100);

/// A server that listens, and does not answer yet.
#[derive(Debug)]
pub struct Viewer {
    guard: Guard,
    listener: TcpListener,
    address: SocketAddr,
}

/// What was served.
#[derive(Debug)]
pub struct Served {
    /// The link to the page.
    pub link: String,
    /// Number of pictures rendered.
    pub pictures: u64,
    /// Number of viewers.
    pub viewers: u64,
}

impl Viewer {
    /// Listens at a port: of this machine alone, or of the address `bind`, by which others have access.
    pub fn listen(bind: Option<IpAddr>, port: u16) -> Result<Self> {
        let guard = Guard::new(bind)?;
        let (listener, address) = listen(bind, port)?;
        Ok(Self { guard, listener, address })
    }

    /// Serves a scene or a rig until the flag that `watch` returns is set. `ready` gets the link to the page.
    pub fn serve(
        self,
        shown: Shown,
        settings: ViewSettings,
        watch: impl FnOnce() -> Result<Arc<AtomicBool>>,
        ready: impl FnOnce(&str),
    ) -> Result<Served> {
        let Self { guard, listener, address } = self;
        let queue = Arc::new(RequestQueue::default());
        let opened = open(shown, &settings, &queue)?;
        let info = session_info(&opened, &settings).to_string();
        let Opened { source, start_view, video, .. } = opened;
        let scene = source.scene().clone();
        let mut renderer = ViewRenderer::new(source, settings.held_out, scene.views[start_view].camera.clone());
        let (interrupted, stopped_queue) = (watch()?, Arc::clone(&queue));
        std::thread::spawn(move || {
            while !interrupted.load(Ordering::Relaxed) {
                sleep(INTERRUPT_POLL);
            }
            stopped_queue.stop();
        });
        let link = format!("http://{}/{}", reachable(address), guard.query());
        let app = App::new(Arc::clone(&queue), scene, video.map(|(steps, _)| steps), info, guard);
        let server = Server::start(listener, app)?;
        ready(&link);
        serve(&queue, &mut renderer, settings.error_text);
        let viewers = queue.joined();
        server.stop()?;
        Ok(Served { link, pictures: renderer.pictures, viewers })
    }
}

/// Serves requests until the queue is stopped.
fn serve(queue: &RequestQueue, renderer: &mut ViewRenderer, error_text: fn(&anyhow::Error) -> String) {
    // Before the first client, as many photos are prepared as a first picture takes.
    let mut first = renderer.source.needed_first();
    let mut waiting = Waiting::default();
    loop {
        waiting.start_search(queue, renderer);
        let prepare = renderer.source.unprepared() > 0 && (first > 0 || queue.has_clients());
        match queue.next(prepare) {
            Task::Stop => return,
            Task::Frame { client, request } => {
                let message = match renderer.frame(&request) {
                    Ok(frame) => Message::Frame(frame.into()),
                    Err(error) => Message::Text(json!({ "error": error_text(&error), "id": request.id }).to_string()),
                };
                queue.send(client, message);
                let waits = renderer.awaited(&request.viewpoint, request.moving).is_some();
                waiting.set_view(client, Some(request).filter(|_| waits));
            }
            Task::File { request: FileRequest::Picture(viewpoint), reply }
                if renderer.awaited(&viewpoint, false).is_some() =>
            {
                waiting.add_file(viewpoint, reply);
            }
            Task::Found { view, found } => {
                renderer.source.insert(view, found);
                waiting.update(queue, renderer);
            }
            // Sending fails if the client has left.
            Task::File { request, reply } => {
                drop(reply.send(renderer.file(&request).map_err(|error| FileError::Failed(error_text(&error)))));
            }
            Task::Prepare => {
                first = first.saturating_sub(1);
                // An unreadable photo is reported with the first picture that needs it.
                let _ = renderer.prepare();
            }
        }
    }
}

/// What is viewed.
#[derive(Debug)]
pub enum Shown {
    /// The photos of a scene.
    Photos(Box<Synthesizer>),
    /// The video of a rig.
    Video {
        /// The rig, and how its pictures are rendered.
        rig: Box<RigSettings>,
        /// Layers per run of the network.
        batch: usize,
        /// Time steps per second.
        rate: f64,
    },
}

/// How it is shown.
#[derive(Debug)]
pub struct ViewSettings {
    /// Indices of the photos or cameras that are held out.
    pub held_out: Vec<usize>,
    /// Execution provider and precision, such as `cpu, f32`.
    pub engine: String,
    /// Whether photos and layers are weighted without a network.
    pub without_network: bool,
    /// Number of threads.
    pub threads: usize,
    /// Takes notes for the user.
    pub note: fn(&str),
    /// The text of an error for the page.
    pub error_text: fn(&anyhow::Error) -> String,
}

/// A source of pictures, and what the session is described by.
struct Opened {
    source: Box<dyn Source>,
    /// Index of the view near which clients start.
    start_view: usize,
    /// The nearest depth, scene units.
    near: Option<f64>,
    /// The number of time steps of a rig, and how many a second.
    video: Option<(usize, f64)>,
}

/// Opens what is shown.
///
/// # Errors
///
/// No picture can be rendered at the first viewpoint: reported now rather than to each client.
fn open(shown: Shown, settings: &ViewSettings, queue: &Arc<RequestQueue>) -> Result<Opened> {
    match shown {
        Shown::Photos(synthesizer) => open_photos(*synthesizer, settings, queue),
        Shown::Video { rig, batch, rate } => open_rig(*rig, (batch, rate), settings),
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

fn open_rig(rig: RigSettings, (batch, rate): (usize, f64), settings: &ViewSettings) -> Result<Opened> {
    let (scene, held_out) = (rig.rig.views.scene(), &settings.held_out);
    let start_view = start_view(scene, held_out)?;
    let camera = scene.views[start_view].camera.clone();
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let steps = rig.rig.steps(&free)?;
    let video = Video::open(rig, free, batch)?;
    video.cameras_for(&camera)?;
    Ok(Opened { near: Some(video.near()), source: Box::new(video), start_view, video: Some((steps, rate)) })
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

/// The first message to each client: the scene, its cameras, and the engine.
fn session_info(opened: &Opened, settings: &ViewSettings) -> Value {
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
        "video": video.map(|(steps, rate)| json!({ "steps": steps, "rate": rate })),
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
