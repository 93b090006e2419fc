//! The output files of `render`: pictures, disparity maps, comparisons, a video.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use liveview::geometry::Size;
use liveview::image::{JPEG_QUALITY, encode, encode_gray16_png, encode_with_quality};
use liveview::{Frame, ImageRgb};
use liveview_live::FrameRate;
use liveview_live::ffmpeg::{Encoder, is_video};
use liveview_synthesizer::Shot;
use liveview_synthesizer::colormap::{coloured, difference, side_by_side};
use serde_json::json;

use crate::args::numbers::frame_rate;
use crate::args::{OutputPath, Variant, has_extension, numbers, write_atomically};
use crate::console::print_note;
use crate::outputs::OutputPlan;

/// Amplification of the difference in a comparison.
const DIFFERENCE_FACTOR: f32 = 4.0;

/// Options that say what to write.
#[derive(Debug, Args)]
pub(super) struct OutputArgs {
    /// Picture (.png, .jpg), folder, or video (.mp4, .gif; needs ffmpeg)
    #[arg(short, long, value_name = "PATH", required_unless_present = "heldout")]
    output: Option<PathBuf>,
    /// Also write disparity, as 16-bit PNG and in colour
    ///
    /// A file, or a folder for several pictures. Disparity is 1/depth: the values 0 to 65535
    /// stand for 0 to the disparity_max in *_scale.json, in 1/scene unit. *_colour.png is dark at far, light at near.
    #[arg(long, value_name = "PNG")]
    depth: Option<PathBuf>,
    /// Also write photo, picture and 4 times their difference
    ///
    /// A file, or a folder for several pictures.
    #[arg(long, value_name = "PNG")]
    compare: Option<PathBuf>,
    /// Write JPEG of this quality, 1 to 100, into a folder too [default: PNG into a folder, else 95]
    #[arg(long, value_name = "Q", value_parser = |text: &str| numbers::in_range(text, 1..=100_u8), requires = "output")]
    jpeg_quality: Option<u8>,
    /// Frames per second of a video, 1 to 1000, such as 29.97 or 30000/1001
    #[arg(long, value_name = "N", default_value = "30", value_parser = frame_rate)]
    fps: FrameRate,
}

/// The files of a comparison.
const COMPARISON: [Variant; 1] = [("", None)];

/// All output files.
pub(super) struct Outputs {
    pictures: Option<OutputPath>,
    video: Option<Encoder>,
    depth: Option<OutputPath>,
    compare: Option<OutputPath>,
    jpeg_quality: Option<u8>,
    /// Number of shots written.
    pub(super) written: usize,
}

impl Outputs {
    /// Checks the options, before anything is opened.
    pub(super) fn new(args: &OutputArgs, have_truth: bool) -> Result<Self> {
        let video = args.output.as_deref().filter(|path| is_video(path));
        if let (Some(path), false) = (&args.compare, have_truth) {
            bail!("--compare {}: there is no photo to compare with; expected --target or --heldout", path.display());
        }
        let parse = |option, path: &Option<PathBuf>, extensions: &[&str]| {
            path.as_ref().map(|path| OutputPath::new(option, path, extensions)).transpose()
        };
        let pictures =
            if video.is_some() { None } else { parse("-o", &args.output, &["png", "jpg", "jpeg", "mp4", "gif"])? };
        if let (Some(quality), Some(path)) = (args.jpeg_quality, &args.output)
            && !matches!(&pictures, Some(OutputPath::Folder(_)))
            && !has_extension(path, &["jpg", "jpeg"])
        {
            bail!("--jpeg-quality {quality}, -o {}: expected a name that ends in .jpg, or a folder", path.display());
        }
        let (depth, compare) = (parse("--depth", &args.depth, &["png"])?, parse("--compare", &args.compare, &["png"])?);
        Ok(Self {
            pictures,
            video: video.map(|path| Encoder::new(path, args.fps, print_note)).transpose()?,
            depth,
            compare,
            jpeg_quality: args.jpeg_quality,
            written: 0,
        })
    }

    /// Checks the options against the names and sizes of what will be rendered, before the work.
    pub(super) fn plan_outputs(&mut self, pictures: &[(&str, Size)], output_plan: &mut OutputPlan) -> Result<()> {
        let outputs: [(&str, &Option<OutputPath>, &[Variant]); 3] = [
            ("-o", &self.pictures, &self.picture()),
            ("--depth", &self.depth, &DEPTH),
            ("--compare", &self.compare, &COMPARISON),
        ];
        for (option, output, variants) in outputs {
            let Some(output) = output else { continue };
            if let (OutputPath::File(path), true) = (output, pictures.len() > 1) {
                let (path, count) = (path.display(), pictures.len());
                bail!("{option} {path}: one file for {count} pictures; expected a folder");
            }
            if let OutputPath::Folder(folder) = output {
                output_plan.folder(option, folder)?;
            }
            let files = pictures.iter().flat_map(|(name, _)| variants.iter().map(move |variant| (name, variant)));
            for (name, &(suffix, extension)) in files {
                let file = output.file(name, suffix, extension);
                match extension {
                    Some(_) => output_plan.named_file(option, &file)?,
                    None => output_plan.file(option, &file)?,
                }
            }
        }
        if let Some(video) = &self.video {
            output_plan.file("-o", video.path())?;
            let sizes: HashSet<_> = pictures.iter().map(|(_, size)| *size).collect();
            if sizes.len() != 1 {
                bail!("-o {}: the pictures have different sizes; expected a folder", video.path().display());
            }
        }
        Ok(())
    }

    /// The folder of pictures.
    pub(super) fn folder(&self) -> Option<&Path> {
        if let Some(OutputPath::Folder(folder)) = &self.pictures { Some(folder) } else { None }
    }

    /// The files of a picture.
    fn picture(&self) -> [Variant; 1] {
        [("", self.jpeg_quality.filter(|_| self.folder().is_some()).map(|_| "jpg"))]
    }

    /// All files of a shot.
    pub(super) fn files(&self, shot: &Shot) -> Vec<PathBuf> {
        let mut files = Vec::new();
        files.extend(self.pictures.iter().flat_map(|place| place.files(shot, self.picture())));
        files.extend(self.depth.iter().flat_map(|place| place.files(shot, DEPTH)));
        let compare = self.compare.iter().filter(|_| shot.truth.is_some());
        files.extend(compare.flat_map(|place| place.files(shot, COMPARISON)));
        files
    }

    /// Writes a rendered shot.
    pub(super) fn write(&mut self, shot: &Shot, frame: &Frame, truth: Option<&ImageRgb>) -> Result<()> {
        let picture = frame.picture();
        if let Some(video) = &mut self.video {
            video.add(&picture)?;
        }
        if let Some(place) = &self.pictures {
            let [file] = place.files(shot, self.picture());
            let quality = self.jpeg_quality.unwrap_or(JPEG_QUALITY);
            write_atomically(&file, &encode_with_quality(&file, &picture, quality)?)?;
        }
        if let Some(place) = &self.depth {
            for (file, contents) in place.files(shot, DEPTH).iter().zip(disparity(shot, frame)?) {
                write_atomically(file, &contents)?;
            }
        }
        if let (Some(place), Some(truth)) = (&self.compare, truth) {
            let [file] = place.files(shot, COMPARISON);
            let difference = difference(truth, &picture, DIFFERENCE_FACTOR);
            write_atomically(&file, &encode(&file, &side_by_side(&[truth, &picture, &difference]))?)?;
        }
        self.written += 1;
        Ok(())
    }

    /// Finishes the video, if there is one, and returns its file.
    pub(super) fn finish(self) -> Result<Option<PathBuf>> {
        self.video.map(Encoder::finish).transpose()
    }
}

/// The files of a disparity map: 16 bits, in colour, scale.
pub(super) const DEPTH: [Variant; 3] = [("", None), ("_colour", None), ("_scale", Some("json"))];

/// Largest disparity of a frame (1/scene unit): 65535 in the 16-bit PNG.
pub(super) fn disparity_max(frame: &Frame) -> f32 {
    frame.disparity.iter().copied().fold(0.0, f32::max)
}

/// The contents of the files of [`DEPTH`].
pub(super) fn disparity(shot: &Shot, frame: &Frame) -> Result<[Vec<u8>; 3]> {
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
