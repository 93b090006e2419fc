//! Output files of `render`: pictures, disparity maps, comparisons, a video.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use liveview::fs::atomic::is_special;
use liveview::image::{coloured, difference, encode, encode_gray16_png, side_by_side};
use liveview::{Frame, ImageRgb, Shot};
use liveview_common::args::frame_rate::{FrameRate, frame_rate};
use liveview_common::args::output::{Place, Variant, write_whole};
use liveview_common::ffmpeg::{Encoder, is_video};
use liveview_common::outputs::{OutputPlan, note_other_pictures};
use serde_json::json;

use super::record::{self, Fields, Record};
use super::rendered::Rendered;
use crate::shard::Shard;

/// Factor by which a comparison shows the difference.
const DIFFERENCE_FACTOR: f32 = 4.0;

/// Options that say what to write.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output (several pictures go into a folder, each under its view's name)")]
pub(super) struct OutputArgs {
    /// The picture: .png or .jpg; or a folder; or .mp4 or .gif through ffmpeg
    #[arg(short, long, value_name = "PATH", required_unless_present = "heldout")]
    output: Option<PathBuf>,
    /// Disparity as 16-bit PNG (0 to 65535 is 0 to the disparity_max in *_scale.json beside it, in 1/scene unit), and in
    /// colour as *_colour.png (dark at far, light at near)
    #[arg(long, value_name = "PNG")]
    depth: Option<PathBuf>,
    /// Truth, result and 4 × their absolute difference, side by side
    #[arg(long, value_name = "PNG")]
    compare: Option<PathBuf>,
    /// Frames per second of a video: 30, 29.97 or 30000/1001
    #[arg(long, value_name = "N", default_value = "30", value_parser = frame_rate)]
    fps: FrameRate,
    /// Continue an interrupted run into the same folder: pictures that its liveview.json lists, and that are unchanged, are kept, and
    /// the rest is rendered. Refused where that file is of another job
    #[arg(long, requires = "output", conflicts_with = "explain")]
    resume: bool,
}

/// The picture, under the name given.
const PLAIN: [Variant; 1] = [("", None)];
/// Disparity, the same in colour, and its scale.
const DEPTH: [Variant; 3] = [("", None), ("_colour", None), ("_scale", Some("json"))];

/// All output files.
pub(super) struct Outputs {
    pictures: Option<Place>,
    shard: Option<Shard>,
    video: Option<Encoder>,
    depth: Option<Place>,
    compare: Option<Place>,
    resume: bool,
    /// The record of a folder of pictures.
    record: Option<Record>,
}

impl Outputs {
    /// Checks the options by themselves, before anything is opened.
    pub(super) fn new(args: &OutputArgs, have_truth: bool, shard: Option<Shard>) -> Result<Self> {
        let video = args.output.as_deref().filter(|path| is_video(path));
        if let (Some(path), false) = (&args.compare, have_truth) {
            bail!("--compare {}: there is no photo to compare with; expected --target or --heldout", path.display());
        }
        let place = |option, path: &Option<PathBuf>, endings: &[&str]| {
            path.as_ref().map(|path| Place::new(option, path, endings)).transpose()
        };
        let pictures =
            if video.is_some() { None } else { place("-o", &args.output, &["png", "jpg", "jpeg", "mp4", "gif"])? };
        if let (true, Some(path), None | Some(Place::File(_))) = (args.resume, &args.output, &pictures) {
            bail!("--resume, -o {}: only a folder of pictures can be continued; expected one", path.display());
        }
        let (depth, compare) = (place("--depth", &args.depth, &["png"])?, place("--compare", &args.compare, &["png"])?);
        if let Some(shard) = shard {
            let places = [
                ("-o", &args.output, &pictures),
                ("--depth", &args.depth, &depth),
                ("--compare", &args.compare, &compare),
            ];
            let file =
                places.iter().find(|(_, path, place)| path.is_some() && !matches!(place, Some(Place::Folder(_))));
            if let Some((option, Some(path), _)) = file {
                let path = path.display();
                bail!(
                    "--shard {shard}, {option} {path}: a shard writes into a folder; expected one (`liveview join` makes the video)"
                );
            }
        }
        Ok(Self {
            pictures,
            shard,
            video: video.map(|path| Encoder::new(path, args.fps)).transpose()?,
            depth,
            compare,
            resume: args.resume,
            record: None,
        })
    }

    /// Checks the options against what will be rendered, before the work.
    pub(super) fn plan_outputs(&mut self, shots: &[Shot], output_plan: &mut OutputPlan) -> Result<()> {
        let places: [(&str, &Option<Place>, &[Variant]); 3] =
            [("-o", &self.pictures, &PLAIN), ("--depth", &self.depth, &DEPTH), ("--compare", &self.compare, &PLAIN)];
        for (option, place, variants) in places {
            let Some(place) = place else { continue };
            if let (Place::File(path), true) = (place, shots.len() > 1) {
                let (path, count) = (path.display(), shots.len());
                bail!("{option} {path}: one file, but {count} pictures are rendered; expected a folder");
            }
            let wanted = shots.iter().flat_map(|shot| variants.iter().map(|v| place.file(shot, v.0, v.1)));
            for file in wanted {
                output_plan.file(option, &file)?;
            }
        }
        if let Some(Place::Folder(folder)) = &self.pictures {
            let record = folder.join(record::name(self.shard));
            if is_special(&record) {
                let record = record.display();
                bail!("-o {record}: no file that can be read again; expected the record of an earlier run, or nothing");
            }
            output_plan.file("-o", &record)?;
        }
        if let Some(video) = &mut self.video {
            output_plan.file("-o", video.path())?;
            let sizes: HashSet<_> = shots.iter().map(|shot| shot.target.size()).collect();
            match sizes.into_iter().collect::<Vec<_>>()[..] {
                [size] => video.set_size(size),
                _ => bail!("-o {}: the pictures have different sizes; expected a folder", video.path().display()),
            }
        }
        Ok(())
    }

    /// Opens the record of a folder of pictures; with `--resume` it prints how many are kept. `shots` are those to be rendered, of
    /// `all` shots of the job.
    pub(super) fn begin(
        &mut self,
        shots: &[Shot],
        all: &[Shot],
        fields: impl FnOnce() -> Result<Fields>,
    ) -> Result<()> {
        let Some(Place::Folder(folder)) = &self.pictures else { return Ok(()) };
        let names = || all.iter().map(|shot| shot.name.clone()).collect();
        let mut record = Record::new(folder, fields()?, self.shard.map(|shard| (shard, names())));
        if self.resume {
            record.resume(&shots.iter().map(|shot| (shot.name.as_str(), self.files(shot))).collect::<Vec<_>>())?;
        }
        record.begin()?;
        self.record = Some(record);
        Ok(())
    }

    /// The picture of a shot that an earlier run has written, if it is kept.
    pub(super) fn kept(&self, shot: &Shot) -> Option<Rendered> {
        self.record.as_ref()?.kept(shot, self.files(shot))
    }

    /// All files of a shot.
    pub(super) fn files(&self, shot: &Shot) -> Vec<PathBuf> {
        let mut files = Vec::new();
        files.extend(self.pictures.iter().flat_map(|place| place.files(shot, PLAIN)));
        files.extend(self.depth.iter().flat_map(|place| place.files(shot, DEPTH)));
        let compare = self.compare.iter().filter(|_| shot.truth.is_some());
        files.extend(compare.flat_map(|place| place.files(shot, PLAIN)));
        files
    }

    /// Writes one rendered shot; returns the digests of its files.
    pub(super) fn write(&mut self, shot: &Shot, frame: &Frame, truth: Option<&ImageRgb>) -> Result<Vec<String>> {
        if let Some(video) = &mut self.video {
            video.add(&frame.picture)?;
        }
        let mut digests = Vec::new();
        let mut write = |file: &Path, contents: &[u8]| {
            // Of the contents, not of the file: another process may have written to that since.
            digests.push(record::digest(contents));
            write_whole(file, contents)
        };
        if let Some(place) = &self.pictures {
            let [file] = place.files(shot, PLAIN);
            write(&file, &encode(&file, &frame.picture)?)?;
        }
        if let Some(place) = &self.depth {
            for (file, contents) in place.files(shot, DEPTH).iter().zip(disparity(shot, frame)?) {
                write(file, &contents)?;
            }
        }
        if let (Some(place), Some(truth)) = (&self.compare, truth) {
            let [file] = place.files(shot, PLAIN);
            let difference = difference(truth, &frame.picture, DIFFERENCE_FACTOR);
            write(&file, &encode(&file, &side_by_side(&[truth, &frame.picture, &difference]))?)?;
        }
        Ok(digests)
    }

    /// Records a shot that is written.
    pub(super) fn written(&mut self, one: &Rendered, digests: Vec<String>) -> Result<()> {
        self.record.as_mut().map_or(Ok(()), |record| record.add(one, digests))
    }

    /// After a failure, prints how to continue, if that is possible.
    pub(super) fn print_how_to_resume(&self, wanted: usize) {
        self.record.iter().for_each(|record| record.print_how_to_resume(wanted));
    }

    /// Closes the video, if there is one, and returns its file; tells pictures in the folders that are not of these shots.
    pub(super) fn finish(self, all: &[Shot]) -> Result<Option<PathBuf>> {
        let files: Vec<PathBuf> = all.iter().flat_map(|shot| self.files(shot)).collect();
        let files: HashSet<&Path> = files.iter().map(|file| file.as_path()).collect();
        let mut folders: Vec<&Path> = files.iter().filter_map(|file| file.parent()).collect();
        folders.sort_unstable();
        folders.dedup();
        // A single picture is nobody's sequel.
        if all.len() > 1 {
            folders.into_iter().for_each(|folder| note_other_pictures(folder, |path| files.contains(path)));
        }
        self.video.map(Encoder::finish).transpose()
    }
}

/// Largest disparity of a frame (1/scene unit): 65535 in the 16-bit PNG.
pub(super) fn disparity_max(frame: &Frame) -> f32 {
    frame.disparity.iter().copied().fold(0.0, f32::max)
}

/// The files of [`DEPTH`].
fn disparity(shot: &Shot, frame: &Frame) -> Result<[Vec<u8>; 3]> {
    let largest = disparity_max(frame);
    let unit = if largest > 0.0 { 65535.0 / largest } else { 0.0 };
    let values: Vec<u16> = frame.disparity.iter().map(|disparity| (disparity * unit).round() as u16).collect();
    let colour = coloured(frame.disparity.view(), (1.0 / shot.far) as f32, (1.0 / shot.near) as f32);
    let scale = json!({
        "liveview": env!("CARGO_PKG_VERSION"), "disparity": "value / 65535 * disparity_max", "disparity_max": largest, "unit": "1/scene unit",
    });
    let grey = encode_gray16_png(shot.target.width(), shot.target.height(), &values)?;
    Ok([grey, encode("disparity.png".as_ref(), &colour)?, format!("{scale:#}\n").into_bytes()])
}
