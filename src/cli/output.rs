//! What is written, and where: pictures, disparity maps, comparisons.

use std::collections::{HashMap, HashSet};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use clap::Args;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use liveview::image_io::{ImageRgb, save_gray16_png, save_png};
use liveview::picture::{coloured, difference, side_by_side};
use liveview::render::Frame;
use serde_json::json;

use super::encoder::Video;
use super::setup::{Photos, Shot};

/// Factor by which a comparison shows the difference.
const DIFFERENCE_FACTOR: f32 = 4.0;

const JPEG_QUALITY: u8 = 95;

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
    /// Frames per second of a video
    #[arg(long, value_name = "N", default_value = "30", value_parser = super::count)]
    fps: usize,
}

/// One file, or a folder of them.
enum Place {
    File(PathBuf),
    Folder(PathBuf),
}

impl Place {
    /// By what is there, else by the extension: a folder has none.
    fn new(option: &str, path: &Path, endings: &[&str]) -> Result<Self> {
        if path.is_dir() || path.as_os_str().to_string_lossy().ends_with('/') || path.extension().is_none() {
            return Ok(Self::Folder(path.to_owned()));
        }
        if !endings.iter().any(|ending| has_ending(path, ending)) {
            bail!("{option} {}: expected a name that ends in .{}, or a folder", path.display(), endings.join(", ."));
        }
        Ok(Self::File(path.to_owned()))
    }

    /// The file of a shot.
    fn file(&self, shot: &Shot, suffix: &str, ending: Option<&str>) -> PathBuf {
        let (folder, mut name, own) = match self {
            Self::File(path) => (path.parent(), path.file_stem().unwrap_or_default().to_owned(), path.extension()),
            Self::Folder(path) => (Some(path.as_path()), stem(&shot.name).into(), None),
        };
        // Joined as they are: a name need not be UTF-8.
        name.push(suffix);
        name.push(".");
        name.push(ending.map(OsStr::new).or(own).unwrap_or(OsStr::new("png")));
        folder.unwrap_or(Path::new("")).join(name)
    }

    /// The files of a shot, one per variant.
    fn files<const N: usize>(&self, shot: &Shot, variants: [Variant; N]) -> [PathBuf; N] {
        variants.map(|(suffix, ending)| self.file(shot, suffix, ending))
    }
}

/// What is added to a name, and its ending if it is not the name's own.
type Variant = (&'static str, Option<&'static str>);

/// A picture under the name given.
const PLAIN: [Variant; 1] = [("", None)];
/// Disparity, in colour, and its scale.
const DEPTH: [Variant; 3] = [("", None), ("_colour", None), ("_scale", Some("json"))];

/// Refuses a file that cannot be written or is a photo of the scene; creates missing folders.
fn claim(option: &str, file: &Path, photos: &Photos) -> Result<()> {
    let refused = |error| anyhow!("{option} {}: cannot be written: {error}", file.display());
    let probe = temporary(file);
    std::fs::create_dir_all(file.parent().unwrap_or(Path::new(""))).map_err(refused)?;
    std::fs::write(&probe, "").and_then(|()| std::fs::remove_file(&probe)).map_err(refused)?;
    let Ok(taken) = file.canonicalize() else { return Ok(()) };
    if photos.scene.views.iter().any(|view| view.image_path().canonicalize().is_ok_and(|photo| photo == taken)) {
        bail!("{option} {}: would overwrite a photo of the scene; expected another place", file.display());
    }
    Ok(())
}

/// Refuses, before any work, a picture that is no PNG or cannot be written.
pub(super) fn claim_png(option: &str, file: &Path, photos: &Photos) -> Result<()> {
    match Place::new(option, file, &["png"])? {
        Place::File(file) => claim(option, &file, photos),
        Place::Folder(path) => bail!("{option} {}: expected a name that ends in .png", path.display()),
    }
}

/// Everything that is written.
pub(super) struct Outputs {
    pictures: Option<Place>,
    video: Option<Video>,
    depth: Option<Place>,
    compare: Option<Place>,
}

impl Outputs {
    /// Checks the options by themselves, before anything is opened.
    pub(super) fn new(args: &OutputArgs, have_truth: bool) -> Result<Self> {
        let video =
            args.output.as_deref().filter(|path| !path.is_dir() && ["mp4", "gif"].iter().any(|e| has_ending(path, e)));
        if let (Some(path), false) = (&args.compare, have_truth) {
            bail!("--compare {}: there is no photo to compare with; expected --target or --heldout", path.display());
        }
        let place = |option, path: &Option<PathBuf>, endings: &[&str]| {
            path.as_ref().map(|path| Place::new(option, path, endings)).transpose()
        };
        Ok(Self {
            pictures: if video.is_some() {
                None
            } else {
                place("-o", &args.output, &["png", "jpg", "jpeg", "mp4", "gif"])?
            },
            video: video.map(|path| Video::new(path, args.fps)).transpose()?,
            depth: place("--depth", &args.depth, &["png"])?,
            compare: place("--compare", &args.compare, &["png"])?,
        })
    }

    /// Checks the options against what will be rendered, before the work; creates missing folders.
    pub(super) fn claim(&mut self, shots: &[Shot], photos: &Photos) -> Result<()> {
        let mut files = HashMap::new();
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
                claim(option, &file, photos)?;
                if let Some(other) = files.insert(std::path::absolute(&file)?, option) {
                    let file = file.display();
                    bail!("{option} {file}: {other} would write another picture there; expected different places");
                }
            }
        }
        if let Some(video) = &mut self.video {
            claim("-o", video.path(), photos)?;
            let sizes: HashSet<_> = shots.iter().map(|shot| (shot.target.width(), shot.target.height())).collect();
            match sizes.into_iter().collect::<Vec<_>>()[..] {
                [size] => video.set_size(size),
                _ => bail!("-o {}: the pictures have different sizes; expected a folder", video.path().display()),
            }
        }
        Ok(())
    }

    /// Writes one rendered shot; the files.
    pub(super) fn write(&mut self, shot: &Shot, frame: &Frame, truth: Option<&ImageRgb>) -> Result<Vec<PathBuf>> {
        let mut written = Vec::new();
        if let Some(video) = &mut self.video {
            video.add(&frame.picture)?;
        }
        if let Some(place) = &self.pictures {
            let [file] = place.files(shot, PLAIN);
            save_picture(&file, &frame.picture)?;
            written.push(file);
        }
        if let Some(place) = &self.depth {
            let files = place.files(shot, DEPTH);
            write_depth(&files, shot, frame)?;
            written.extend(files);
        }
        if let (Some(place), Some(truth)) = (&self.compare, truth) {
            let [file] = place.files(shot, PLAIN);
            let difference = difference(truth, &frame.picture, DIFFERENCE_FACTOR);
            save_png(&file, &side_by_side(&[truth, &frame.picture, &difference]))?;
            written.push(file);
        }
        Ok(written)
    }

    /// Closes the video, if there is one; its file.
    pub(super) fn finish(self) -> Result<Option<PathBuf>> {
        self.video.map(Video::finish).transpose()
    }
}

/// Largest disparity of a frame: what 65535 stands for.
pub(super) fn disparity_max(frame: &Frame) -> f32 {
    frame.disparity.iter().copied().fold(0.0, f32::max)
}

fn write_depth([grey, colour, scale]: &[PathBuf; 3], shot: &Shot, frame: &Frame) -> Result<()> {
    let largest = disparity_max(frame);
    let unit = if largest > 0.0 { 65535.0 / largest } else { 0.0 };
    let values: Vec<u16> = frame.disparity.iter().map(|disparity| (disparity * unit).round() as u16).collect();
    save_gray16_png(grey, shot.target.width(), shot.target.height(), &values)?;
    save_png(colour, &coloured(frame.disparity.view(), (1.0 / shot.far) as f32, (1.0 / shot.near) as f32))?;
    let sidecar =
        json!({ "disparity": "value / 65535 * disparity_max", "disparity_max": largest, "unit": "1/scene unit" });
    write_whole(scale, format!("{sidecar:#}\n").as_bytes())
}

/// PNG, or JPEG by the name's ending.
fn save_picture(path: &Path, picture: &ImageRgb) -> Result<()> {
    if !has_ending(path, "jpg") && !has_ending(path, "jpeg") {
        return Ok(save_png(path, picture)?);
    }
    let mut file = Vec::new();
    let (width, height) = (u32::try_from(picture.width())?, u32::try_from(picture.height())?);
    JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY)
        .encode(&bytes(picture), width, height, ExtendedColorType::Rgb8)
        .map_err(|error| anyhow!("{}: cannot be written: {error}", path.display()))?;
    write_whole(path, &file)
}

/// 8-bit RGB.
pub(super) fn bytes(picture: &ImageRgb) -> Vec<u8> {
    picture.data().iter().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8).collect()
}

/// All of a file or nothing: under a temporary name first.
pub(super) fn write_whole(path: &Path, contents: &[u8]) -> Result<()> {
    let temporary = temporary(path);
    std::fs::write(&temporary, contents).and_then(|()| std::fs::rename(&temporary, path)).map_err(|error| {
        // It failed already; a leftover that cannot be removed adds nothing to that.
        let _ = std::fs::remove_file(&temporary);
        anyhow!("{}: cannot be written: {error}", path.display())
    })
}

/// A hidden name in the same folder, with the same ending.
pub(super) fn temporary(path: &Path) -> PathBuf {
    let mut name = OsString::from(format!(".{}.", std::process::id()));
    name.push(path.file_name().unwrap_or_default());
    path.with_file_name(name)
}

/// A view's name as that of a file, without extension.
fn stem(name: &str) -> String {
    Path::new(&name.replace('/', "_")).with_extension("").to_string_lossy().into_owned()
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
}
