//! `liveview view`: a scene in a browser, from where the mouse, a finger or the keys put the viewpoint.

mod desk;
mod guard;
mod hello;
mod message;
mod pace;
mod page;
mod rate;
mod server;
mod socket;
mod studio;

use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use desk::{Desk, Message, Task};
use guard::Guard;
use liveview::geometry::middle_camera;
use liveview::{Camera, Scene};
use serde_json::json;
use server::{App, Server, listen};
use studio::Studio;

use crate::args::layers::LayerArgs;
use crate::args::model::ModelArgs;
use crate::args::numbers;
use crate::args::scene::SceneArgs;
use crate::args::targets::named;
use crate::console::{Output, full_text, print_message, print_notes};
use crate::interrupt;
use crate::job::Job;

/// Time between looks whether the program is to end.
const LOOK_UP: Duration = Duration::from_millis(100);

const EXAMPLES: &str = "\
Examples:
  liveview view scene
  liveview view scene --engine openvino --precision int8
  liveview view scene --target IMG_7.jpg,IMG_9.jpg
  liveview view scene --bind 192.168.1.2 --port 9000

On the page: drag moves the viewpoint, wheel or pinch goes forward and back, shift-drag turns, as do the arrow keys with shift.";

/// Options of `liveview view`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ViewArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Port of the link; 0: any that is free
    #[arg(long, value_name = "N", default_value_t = 8090)]
    port: u16,
    /// Address of this machine where others can reach it, such as 192.168.1.2; the link then has a token, and whoever has the link can look
    /// [default: this machine alone]
    #[arg(long, value_name = "ADDRESS")]
    bind: Option<IpAddr>,
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

pub(crate) fn run(args: &ViewArgs) -> Result<Output> {
    let guard = Guard::new(args.bind)?;
    let (listener, address) = listen(args.bind, args.port)?;
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    let held_out = held_out(args, photos.scene())?;
    let job = Job::open(photos, &args.layers, &args.model)?;
    let scene = job.scene().clone();
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let cameras: Vec<&Camera> = job.photos().cameras(&free).collect();
    if cameras.is_empty() {
        bail!("every photo is held out; expected some to render from");
    }
    let middle = free[middle_camera(&cameras)];
    let runs = job.synthesizer.renderer().network().run_end().into_iter().collect();
    // What cannot be rendered at all is told now, not to each client.
    let targets = liveview::Targets::cameras(vec![scene.views[middle].camera.clone()]);
    job.synthesizer.shots(liveview::Targets { held_out: held_out.clone(), ..targets })?;

    let mut studio = Studio::new(job, held_out, scene.views[middle].camera.clone());
    let hello = studio.hello(middle);
    let desk = Arc::new(Desk::default());
    let (stop, ending) = (interrupt::watch(runs)?, Arc::clone(&desk));
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            sleep(LOOK_UP);
        }
        ending.stop();
    });
    let link = format!("http://{address}/{}", guard.query());
    let server = Server::start(listener, App::new(Arc::clone(&desk), scene, hello.to_string(), guard))?;
    print_message("open", format_args!("{link} (Ctrl-C ends it)"));
    serve(&desk, &mut studio);
    let viewers = desk.joined();
    server.stop()?;
    let pictures = studio.pictures();
    let text = format!("{pictures} pictures for {viewers} {}\n", if viewers == 1 { "viewer" } else { "viewers" });
    Ok(Output { text, json: json!({ "link": link, "pictures": pictures, "viewers": viewers }) })
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
            Task::Still { camera, reply } => drop(reply.send(studio.still(&camera).map_err(|error| full_text(&error)))),
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
