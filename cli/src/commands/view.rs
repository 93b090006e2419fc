//! `liveview view`: a scene, or the video of a rig, in the browser; the mouse, a finger or keys move the viewpoint.

use std::net::IpAddr;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use liveview_live::FrameRate;
use liveview_live::ffmpeg::end_reading;
use liveview_live::rig::{Rig, SourceClock, Sources};
use liveview_viewer::{Shown, ViewSettings, Viewer};
use serde_json::json;

use crate::args::{LayerArgs, ModelArgs, ModelInfo, SceneArgs, held_out, numbers, source};
use crate::console::{Output, print_message, print_note, print_notes};
use crate::interrupt;
use crate::job::{self, Job};

const EXAMPLES: &str = "\
Examples:
  liveview view scene --open
  liveview view scene --bind 192.168.1.2 --port 9000
  liveview view scene --origin https://notebook.example
  liveview view rig --fps 25
  liveview view rig --source cam00=rtsp://10.0.0.5/1 --source cam01=/dev/video0

The page draws the scene itself, by WebGL 2; `liveview bake` writes it as a file that needs no server.
The space bar starts and stops the video of a rig (see `liveview video --help`).";

/// Options of `liveview view`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ViewArgs {
    /// Port of the link; 0 for any free port
    #[arg(long, value_name = "N", default_value = "8090", value_parser = |text: &str| numbers::in_range(text, 0..=u16::MAX))]
    port: u16,
    /// Network address of this machine, to give others access by a token in the link
    ///
    /// Such as 192.168.1.2. By default only this machine has access.
    #[arg(long, value_name = "ADDRESS")]
    bind: Option<IpAddr>,
    /// Origin of an https front that passes requests on to this program, to give others access by a token
    ///
    /// Such as https://host.example of a tunnel or an ingress.
    #[arg(long, value_name = "URL")]
    origin: Option<String>,
    /// Open the link in the browser
    #[arg(long)]
    open: bool,
    /// Time steps per second of a rig [default: its videos' frame rate, else 30]
    #[arg(long, value_name = "N", value_parser = numbers::frame_rate)]
    fps: Option<FrameRate>,
    /// Camera of a rig that runs, and what ffmpeg opens (see `liveview video --help`); repeatable
    #[arg(long, value_name = "NAME=URL", value_parser = source)]
    source: Vec<(String, PathBuf)>,
    /// Photos to hold out, by name; at the pose of one the picture is compared with it
    #[arg(long, value_name = "NAME", value_delimiter = ',', conflicts_with = "heldout")]
    target: Vec<String>,
    /// Hold out every Nth photo
    #[arg(long, value_name = "N", value_parser = numbers::count)]
    heldout: Option<usize>,
    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    scene: SceneArgs,
}

pub(crate) fn run(args: &ViewArgs) -> Result<Output> {
    let output = view(args);
    end_reading();
    output
}

fn view(args: &ViewArgs) -> Result<Output> {
    let viewer = Viewer::listen(args.bind, args.port, args.origin.as_deref())?;
    let sources = Sources { given: args.source.clone(), clock: SourceClock::Arrival };
    let rig = Rig::find(args.scene.folder(), &args.scene.options(), args.scene.depth(), &sources)?;
    let (shown, held_out, model) = match rig {
        Some(rig) => open_rig(args, rig)?,
        None => open_photos(args)?,
    };
    let settings =
        ViewSettings { held_out, engine: model.engine(), without_network: model.model.is_none(), note: print_note };
    let served = viewer.serve(shown, settings, interrupt::watch, |link| {
        print_message("open", format_args!("{link} (Ctrl-C ends it)"));
        if args.open
            && let Err(error) = open::that_detached(link)
        {
            print_note(&format!("--open: no browser could be started ({error}); open the link yourself"));
        }
    })?;
    let (pictures, viewers) = (served.pictures, served.viewers);
    let text = format!("{pictures} pictures for {viewers} {}\n", if viewers == 1 { "viewer" } else { "viewers" });
    Ok(Output { text, json: json!({ "link": served.link, "pictures": pictures, "viewers": viewers }) })
}

/// What is shown, the views that are held out, and the model.
type Opened = (Shown, Vec<usize>, ModelInfo);

fn open_photos(args: &ViewArgs) -> Result<Opened> {
    if args.fps.is_some() {
        let folder = args.scene.folder().display();
        bail!(
            "--fps: {folder} is a scene of photos; --fps is for a rig, in which each camera has a folder of frames or a video"
        );
    }
    let photos = args.scene.open()?;
    print_notes(&photos.scene().notes);
    let held_out = held_out(photos.scene(), args.heldout, &args.target)?;
    let held_out = photos.scene().with_held_out(held_out);
    let job = Job::open(photos, &args.layers, &args.model)?;
    Ok((Shown::Photos(Box::new(job.synthesizer)), held_out, job.model))
}

fn open_rig(args: &ViewArgs, rig: Rig) -> Result<Opened> {
    let scene = rig.views.scene();
    print_notes(&scene.notes);
    for option in args.layers.unused_for_video() {
        print_note(&format!("{option}: not used for the video of a rig"));
    }
    let mut held_out = held_out(scene, args.heldout, &args.target)?;
    if rig.is_running() {
        let stays_out = |camera: &usize| rig.feeds[*camera].source().is_none() && !held_out.contains(camera);
        let left_out: Vec<usize> = (0..rig.feeds.len()).filter(stays_out).collect();
        left_out
            .iter()
            .for_each(|&camera| print_note(&format!("camera {} has no source: left out", rig.feeds[camera].name)));
        held_out.extend(left_out);
    }
    let rate = args.fps.map_or_else(|| rig.rate(), Ok)?.per_second();
    let (rig, model) = job::open_rig(rig, &args.model, &args.layers.choice, args.layers.keep_exposure)?;
    Ok((Shown::Video { rig: Box::new(rig), rate }, held_out, model))
}
