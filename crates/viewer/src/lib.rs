//! `liveview view`: a scene, or the video of a rig, in a browser, from where the mouse, a finger or the keys put the viewpoint.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

mod app;
mod desk;
mod guard;
mod hello;
mod http;
mod message;
mod page;
mod rate;
mod renderer;
mod routes;
mod server;
mod socket;
mod wish;

use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Result, bail};
use app::App;
use clap::Args;
use desk::Desk;
use guard::Guard;
use hello::{Engine, Playable, hello};
use liveview::geometry::middle_camera;
use liveview::network::RunEnd;
use liveview::{Camera, Scene, Targets};
use liveview_common::args::frame_rate::{FrameRate, frame_rate};
use liveview_common::args::layers::LayerArgs;
use liveview_common::args::model::ModelArgs;
use liveview_common::args::numbers;
use liveview_common::args::scene::SceneArgs;
use liveview_common::args::targets::named;
use liveview_common::console::{Output, full_text, print_message, print_notes};
use liveview_common::interrupt;
use liveview_common::job::Job;
use liveview_live::rig::Rig;
use renderer::{Photos, Source, Studio, Video};
use serde_json::json;
use server::{Server, listen};
use wish::{Message, Task};

/// Time between looks whether the program is to end.
const LOOK_UP: Duration = Duration::from_millis(100);
/// Time steps per second of a rig that does not tell.
const DEFAULT_RATE: f64 = 30.0;

const EXAMPLES: &str = "\
Examples:
  liveview view scene --open
  liveview view scene --engine openvino --precision int8
  liveview view scene --target IMG_7.jpg,IMG_9.jpg
  liveview view scene --bind 192.168.1.2 --port 9000
  liveview view rig --fps 25

On the page: drag moves the viewpoint, wheel or pinch goes forward and back, shift-drag turns, as do the arrow keys with shift. A rig
(`liveview video --help`) plays its video: the space bar starts and stops it.";

/// Options of `liveview view`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ViewArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Port of the link; 0: any that is free
    #[arg(long, value_name = "N", default_value_t = 8090)]
    port: u16,
    /// Address of this machine where others can reach it, such as 192.168.1.2; the link then has a token, and whoever has the link can look
    /// [default: this machine alone]
    #[arg(long, value_name = "ADDRESS")]
    bind: Option<IpAddr>,
    /// Open the link in the browser
    #[arg(long)]
    open: bool,
    /// A rig: time steps per second [default: of videos their own, else 30]
    #[arg(long, value_name = "N", value_parser = frame_rate)]
    fps: Option<FrameRate>,
    /// Photos to hold out, by name: never rendered from, and the picture is scored where the viewpoint stands on one
    #[arg(long, value_name = "NAME", value_delimiter = ',', conflicts_with = "heldout")]
    target: Vec<String>,
    /// Hold out every Nth photo in name order, from the first on
    #[arg(long, value_name = "N", value_parser = numbers::count)]
    heldout: Option<usize>,
    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    model: ModelArgs,
}

/// Runs `liveview view`.
pub fn run(args: &ViewArgs) -> Result<Output> {
    let guard = Guard::new(args.bind)?;
    let (listener, address) = listen(args.bind, args.port)?;
    let Opened { source, engine, runs, held_out, middle, near, video } = open(args)?;
    let scene = source.scene().clone();
    let hello = hello(&scene, &engine, &held_out, middle, near, video);
    let mut studio = Studio::new(source, held_out, scene.views[middle].camera.clone());
    let desk = Arc::new(Desk::default());
    let (stop, ending) = (interrupt::watch(runs)?, Arc::clone(&desk));
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            sleep(LOOK_UP);
        }
        ending.stop();
    });
    let link = format!("http://{address}/{}", guard.query());
    let app = App::new(Arc::clone(&desk), scene, video.map(|video| video.steps), hello.to_string(), guard);
    let server = Server::start(listener, app)?;
    print_message("open", format_args!("{link} (Ctrl-C ends it)"));
    if args.open
        && let Err(error) = open::that_detached(&link)
    {
        print_message("note", format_args!("--open: no browser could be started ({error}); open the link yourself"));
    }
    serve(&desk, &mut studio);
    let viewers = desk.joined();
    server.stop()?;
    let pictures = studio.pictures();
    let text = format!("{pictures} pictures for {viewers} {}\n", if viewers == 1 { "viewer" } else { "viewers" });
    Ok(Output { text, json: json!({ "link": link, "pictures": pictures, "viewers": viewers }) })
}

/// What is looked at, and what renders it.
struct Opened {
    source: Box<dyn Source>,
    engine: Engine,
    runs: Vec<RunEnd>,
    held_out: Vec<usize>,
    /// The view that clients begin at.
    middle: usize,
    /// The nearest depth, scene units.
    near: Option<f64>,
    /// Of a rig.
    video: Option<Playable>,
}

/// Opens the folder. What cannot be rendered at all is told now, not to each client.
fn open(args: &ViewArgs) -> Result<Opened> {
    if let Some(rig) = Rig::find(&args.scene)? {
        return open_rig(args, rig);
    }
    if args.fps.is_some() {
        let folder = args.scene.folder().display();
        bail!("--fps: {folder} is no rig, whose cameras have a folder of frames or a video each; expected it left out");
    }
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    let held_out = held_out(args, photos.scene())?;
    let job = Job::open(photos, &args.layers, &args.model)?;
    let middle = middle(job.scene(), &held_out)?;
    let camera = job.scene().views[middle].camera.clone();
    let targets = Targets { held_out: held_out.clone(), ..Targets::cameras(vec![camera.clone()]) };
    job.synthesizer.shots(targets)?;
    let runs = job.synthesizer.renderer().network().run_end().into_iter().collect();
    let engine = Engine::of(&job.model);
    let photos = Photos::new(job, held_out.clone(), &camera);
    let near = photos.near();
    Ok(Opened { source: Box::new(photos), engine, runs, held_out, middle, near, video: None })
}

fn open_rig(args: &ViewArgs, rig: Rig) -> Result<Opened> {
    let scene = rig.photos.scene();
    print_notes(&scene.notes);
    for option in args.layers.unused_for_video() {
        print_message("note", format_args!("{option}: not used for the video of a rig"));
    }
    let held_out = held_out(args, scene)?;
    let middle = middle(scene, &held_out)?;
    let camera = scene.views[middle].camera.clone();
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let steps = rig.steps(&free)?;
    let rate = match args.fps {
        Some(rate) => rate.per_second(),
        None => rig.rate()?.map_or(DEFAULT_RATE, FrameRate::per_second),
    };
    let (video, model, runs) = Video::open(rig, free, &args.layers, &args.model)?;
    video.cameras_for(&camera)?;
    let near = Some(video.near());
    let playable = Playable { steps, rate };
    Ok(Opened {
        source: Box::new(video),
        engine: Engine::of(&model),
        runs,
        held_out,
        middle,
        near,
        video: Some(playable),
    })
}

/// The view in the middle of those that are not held out.
fn middle(scene: &Scene, held_out: &[usize]) -> Result<usize> {
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let cameras: Vec<&Camera> = free.iter().map(|&view| &scene.views[view].camera).collect();
    if cameras.is_empty() {
        bail!("every photo is held out; expected some to render from");
    }
    Ok(free[middle_camera(&cameras)])
}

/// Renders until the end.
fn serve(desk: &Desk, studio: &mut Studio) {
    // Before anyone comes, as many photos as a first picture takes.
    let mut first = studio.needed_first();
    loop {
        let spare = studio.unprepared() > 0 && (first > 0 || desk.is_watched());
        match desk.next(spare) {
            Task::Stop => return,
            Task::Frame { client, wish } => {
                let message = match studio.frame(&wish) {
                    Ok(frame) => Message::Frame(frame.into()),
                    Err(error) => Message::Text(json!({ "error": full_text(&error), "id": wish.id }).to_string()),
                };
                desk.send(client, message);
            }
            // Whoever asked may be gone.
            Task::File { asked, reply } => drop(reply.send(studio.file(&asked).map_err(|error| full_text(&error)))),
            Task::Spare => {
                first = first.saturating_sub(1);
                // A photo that cannot be read is told to who looks from there.
                let _ = studio.prepare();
            }
        }
    }
}

/// Indices of the photos that are held out.
fn held_out(args: &ViewArgs, scene: &Scene) -> Result<Vec<usize>> {
    match args.heldout {
        Some(1) => bail!("--heldout 1 holds out every photo and leaves none to render from; expected 2 or more"),
        Some(step) => Ok((0..scene.views.len()).step_by(step).collect()),
        None => named(scene, &args.target),
    }
}
