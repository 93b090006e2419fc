//! What is served, and for how long.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use anyhow::Result;
use liveview::Camera;
use liveview::geometry::choose_views;
use liveview_live::rig::{Frames, RigSettings};
use liveview_live::session::CameraDepths;
use liveview_synthesizer::{PhotoCorrection, Synthesizer, Targets};
use serde_json::{Value, json};
use tokio::sync::{Semaphore, watch};

use super::jobs::Jobs;
use super::source::{Rig, Source};
use super::{App, Guard, Server, listen, reachable};
use crate::bake::start_view;
use crate::page::{description, page};

/// Interval at which an interrupt is looked for.
const INTERRUPT_POLL: Duration = Duration::from_millis(100);

/// A server that listens, and does not answer yet.
#[derive(Debug)]
pub struct Viewer {
    guard: Guard,
    /// The link's part before the query, if a front passes requests on.
    origin: Option<String>,
    listener: TcpListener,
    address: SocketAddr,
}

/// What was served.
#[derive(Debug)]
pub struct Served {
    /// The link to the page.
    pub link: String,
    /// Number of pictures rendered at full quality.
    pub pictures: u64,
    /// Number of pages sent.
    pub viewers: u64,
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
    /// Takes notes for the user.
    pub note: fn(&str),
}

impl Viewer {
    /// Listens at a port: of this machine alone, or of the address `bind`, by which others have access. `origin`: the
    /// address of a front by which others have access too, such as `https://host`.
    pub fn listen(bind: Option<IpAddr>, port: u16, origin: Option<&str>) -> Result<Self> {
        let guard = Guard::new(bind, origin)?;
        let (listener, address) = listen(bind, port)?;
        Ok(Self { guard, origin: origin.map(str::to_owned), listener, address })
    }

    /// Serves a scene or a rig until the flag that `watch` returns is set. `ready` gets the link to the page.
    pub fn serve(
        self,
        shown: Shown,
        settings: ViewSettings,
        watch: impl FnOnce() -> Result<Arc<AtomicBool>>,
        ready: impl FnOnce(&str),
    ) -> Result<Served> {
        let Self { guard, origin, listener, address } = self;
        let own = format!("http://{}", reachable(address));
        let link = format!("{}/{}", origin.as_deref().unwrap_or(&own).trim_end_matches('/'), guard.query());
        let (mut source, steps, description) = open(shown, &settings)?;
        let jobs = Arc::new(Jobs::default());
        let (interrupted, stopped) = (watch()?, Arc::clone(&jobs));
        std::thread::spawn(move || {
            while !interrupted.load(Ordering::Relaxed) {
                sleep(INTERRUPT_POLL);
            }
            stopped.stop();
        });
        let viewers = Arc::new(AtomicU64::new(0));
        let app = App {
            jobs: Arc::clone(&jobs),
            scene: source.synthesizer.scene().clone(),
            held_out: settings.held_out.clone(),
            frames: source.rig.as_ref().map(|rig| Arc::clone(&rig.frames)),
            steps,
            page: page(&description, true),
            guard,
            note: settings.note,
            photos: Mutex::default(),
            reading: Semaphore::new(1),
            stopping: watch::Sender::new(false),
            viewers: Arc::clone(&viewers),
        };
        let server = Server::start(listener, app)?;
        ready(&link);
        let pictures = jobs.work(&mut source, |text| (settings.note)(&text));
        server.stop()?;
        Ok(Served { link, pictures, viewers: viewers.load(Ordering::Relaxed) })
    }
}

/// What renders the pictures, the number of time steps, and the description for the page.
///
/// # Errors
///
/// No picture can be rendered at the first viewpoint: reported now rather than to each client.
fn open(shown: Shown, settings: &ViewSettings) -> Result<(Source, usize, Value)> {
    let (synthesizer, rig) = match shown {
        Shown::Photos(synthesizer) => (*synthesizer, None),
        Shown::Video { rig, rate } => {
            let mut rig = *rig;
            let renderer = rig.renderers.pop().expect("the network that all cameras are for");
            let mut synthesizer = Synthesizer::new(rig.rig.views.clone(), renderer, rig.layers);
            if rig.keep_exposure {
                synthesizer.photo_correction = PhotoCorrection { exposure: false, ..Default::default() };
            }
            (synthesizer, Some((rig.rig, rate)))
        }
    };
    let (scene, held_out) = (synthesizer.scene().clone(), &settings.held_out);
    let start = start_view(&scene, held_out)?;
    let camera = &scene.views[start].camera;
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let range = synthesizer.views().depth_range(&free, held_out)?;
    let (mut video, mut steps) = (Value::Null, 1);
    let rig = match rig {
        Some((rig, rate)) => {
            let cameras: Vec<&Camera> = rig.views.cameras(&free).collect();
            choose_views(&cameras, camera, synthesizer.renderer().network().views(), &[])?;
            steps = rig.steps(&free)?;
            video = json!({ "steps": (steps < usize::MAX).then_some(steps), "rate": rate });
            let frames = Arc::new(Frames::new(scene.clone(), &rig.feeds, rate));
            let depths = CameraDepths::new(scene.views.iter().map(|view| view.camera.clone()).collect(), range);
            Some(Rig { frames, views: rig.views, range, free, step: None, depths })
        }
        None => {
            let targets = Targets { held_out: held_out.clone(), ..Targets::cameras(vec![camera.clone()]) };
            synthesizer.shots(targets)?;
            None
        }
    };
    let mut description = description(&scene, held_out, start, range);
    description["served"] = json!({
        "engine": settings.engine, "layers": synthesizer.layers().to_string(), "video": video,
    });
    let ViewSettings { without_network, note, .. } = *settings;
    let source = Source { synthesizer, held_out: held_out.clone(), without_network, note, rig };
    Ok((source, steps, description))
}
