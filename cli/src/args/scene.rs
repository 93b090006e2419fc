//! Options for the scene, and those that say what to render: held-out views, poses from a file, or a path.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use liveview::Camera;
use liveview_scene::Format;
use liveview_scene::cameras::{CameraFile, CameraPath, read_cameras};
use liveview_synthesizer::{Scene, SceneOptions, SceneViews, SynthesisError, Targets};

use super::ADVANCED;
use super::numbers;
use super::output::has_extension;
use crate::console::print_notes;

const HEADING: &str = "What to render (one of these)";

/// Options that say what to render; exactly one is given.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub(crate) struct TargetArgs {
    /// Views of the scene, by name; none of them is used as a source
    #[arg(long, value_name = "NAME,…", help_heading = HEADING)]
    target: Vec<String>,
    /// Every Nth view, rendered from the others (the LLFF protocol)
    #[arg(long, value_name = "N", value_parser = numbers::count, help_heading = HEADING)]
    heldout: Option<usize>,
    /// Camera, list of cameras or nerfstudio camera path, in a JSON file
    ///
    /// A camera is {"transform_matrix": 4x4 world from camera, OpenGL axes} or {"cam_from_world":
    /// 3x4 or 4x4, OpenCV axes}, with fl_x, fl_y, cx, cy, w, h if they differ from those of the
    /// nearest view. A camera path of nerfstudio's viewer is expected in the scene's axes, or with
    /// its model's dataparser_transforms.json beside it.
    #[arg(long, value_name = "FILE", help_heading = HEADING)]
    pose: Option<PathBuf>,
    /// Path of N frames (line:N, circle:N, spiral:N, interpolate:N), or a file as for --pose
    ///
    /// line:N runs between the two outermost views; circle:N and spiral:N run around the centre of
    /// the rig. The camera rotates like the views around it. interpolate:N runs through all photos
    /// in the order of their names, interpolate:N:NAME,… through these photos.
    #[arg(long, value_name = "SHAPE:N|FILE", value_parser = path, help_heading = HEADING)]
    path: Option<CameraPathOrFile>,
}

/// The value of `--path`.
#[derive(Debug, Clone)]
enum CameraPathOrFile {
    Shape(CameraPath),
    /// Through all photos, or those of a list of names.
    Through {
        frames: usize,
        names: Option<String>,
    },
    File(PathBuf),
}

fn path(text: &str) -> Result<CameraPathOrFile, String> {
    if has_extension(Path::new(text), &["json"]) {
        return Ok(CameraPathOrFile::File(text.into()));
    }
    let Some(through) = text.strip_prefix("interpolate:") else {
        let path = text.parse().map(CameraPathOrFile::Shape);
        return path.map_err(|error| format!("{error}; or interpolate:N, interpolate:N:NAME,… or a .json file"));
    };
    let (frames, names) = through.split_once(':').map_or((through, None), |(frames, names)| (frames, Some(names)));
    let frames = numbers::count(frames).map_err(|error| format!("N in {text}: {error}"))?;
    if names == Some("") {
        return Err(format!("{text}: expected names of photos after the last colon"));
    }
    Ok(CameraPathOrFile::Through { frames, names: names.map(str::to_owned) })
}

impl TargetArgs {
    /// Whether the targets have photos to compare with.
    pub(crate) fn have_truth(&self) -> bool {
        self.pose.is_none() && self.path.is_none()
    }

    /// The option that names a file of cameras, and the file.
    pub(crate) fn camera_file(&self) -> (&'static str, Option<&Path>) {
        match &self.path {
            Some(CameraPathOrFile::File(file)) => ("--path", Some(file)),
            _ => ("--pose", self.pose.as_deref()),
        }
    }

    /// The targets in a scene; prints a note if the axes of a file had to be assumed.
    pub(crate) fn resolve(&self, views: &SceneViews) -> Result<Targets> {
        match self.camera_file() {
            (_, Some(file)) => Ok(Targets::cameras(cameras_of(file, views)?)),
            _ => self.targets_of_scene(views.scene()),
        }
    }

    fn targets_of_scene(&self, scene: &Scene) -> Result<Targets> {
        match &self.path {
            Some(CameraPathOrFile::Shape(path)) => match Targets::path(scene, *path) {
                Err(error @ SynthesisError::Path(_)) => bail!("{error}; expected --pose instead"),
                targets => return Ok(targets?),
            },
            Some(CameraPathOrFile::Through { frames, names }) => {
                let all = || Ok((0..scene.views.len()).collect());
                let through = names.as_ref().map_or_else(all, |names| named(scene, std::slice::from_ref(names)))?;
                return Ok(Targets::through(scene, &through, *frames)?);
            }
            Some(CameraPathOrFile::File(_)) | None => {}
        }
        let views = held_out(scene, self.heldout, &self.target)?;
        refuse_twice("--target", scene, &views)?;
        Ok(Targets::held_out(scene, views))
    }
}

/// Reads the cameras of a file; prints a note if their axes had to be assumed.
pub(crate) fn cameras_of(file: &Path, views: &SceneViews) -> Result<Vec<Camera>> {
    let CameraFile { cameras, note } =
        read_cameras(file, &views.all_cameras(), &views.scene().root).map_err(anyhow::Error::msg)?;
    print_notes(note.as_slice());
    Ok(cameras)
}

/// The views that `--heldout` holds out, every so-many-th; without it those of `--target`.
pub(crate) fn held_out(scene: &Scene, every: Option<usize>, names: &[String]) -> Result<Vec<usize>> {
    match every {
        Some(1) => bail!("--heldout 1 holds out every view and leaves none to render from; expected 2 or more"),
        Some(step) => Ok((0..scene.views.len()).step_by(step).collect()),
        None => named(scene, names),
    }
}

/// Refuses views of which an option names one twice.
pub(crate) fn refuse_twice(option: &str, scene: &Scene, views: &[usize]) -> Result<()> {
    match (1..views.len()).find(|&i| views[..i].contains(&views[i])) {
        Some(twice) => bail!("{option} names \"{}\" twice; expected each view once", scene.views[views[twice]].name),
        None => Ok(()),
    }
}

/// The views of these comma-separated lists of names; a name may contain commas.
pub(crate) fn named(scene: &Scene, lists: &[String]) -> Result<Vec<usize>> {
    let mut views = Vec::new();
    for list in lists {
        if let Ok(view) = scene.view_index(list) {
            views.push(view);
            continue;
        }
        let mut rest = Some(list.as_str());
        while let Some(names) = rest {
            let ends = || names.match_indices(',').map(|(at, _)| at).chain([names.len()]);
            let first = ends().find_map(|end| Some((scene.view_index(&names[..end]).ok()?, end)));
            let (view, end) = match first {
                Some(found) => found,
                // The error lists the closest names.
                None => (scene.view_index(&names[..ends().next().unwrap_or(0)])?, names.len()),
            };
            views.push(view);
            rest = names[end..].strip_prefix(',');
        }
    }
    Ok(views)
}

/// Options for the scene and its depth range.
#[derive(Debug, Args)]
pub(crate) struct SceneArgs {
    /// Scene folder (transforms.json, Blender, COLMAP, LLFF, RealEstate10K, Spaces …), its zip, or a transforms.json
    scene: PathBuf,
    /// Scale wider photos down to this width [default: those of more than 2.4 megapixels to that]
    #[arg(long, value_name = "PIXELS", value_parser = numbers::count)]
    width: Option<usize>,
    /// Nearest depth, in scene units [default: from the scene, else found from the photos]
    #[arg(long, value_name = "DEPTH", allow_negative_numbers = true, value_parser = numbers::depth)]
    near: Option<f64>,
    /// Farthest depth, in scene units, or inf [default: as the nearest]
    #[arg(long, value_name = "DEPTH", allow_negative_numbers = true, value_parser = numbers::depth)]
    far: Option<f64>,
    /// Photo folder of a scene, such as images_4 [default: the format's usual ones]
    #[arg(long, value_name = "NAME", help_heading = ADVANCED, hide_short_help = true)]
    images: Option<String>,
    /// Format to read, of several in the folder: transforms, colmap, llff …
    #[arg(long, value_name = "FORMAT", help_heading = ADVANCED, hide_short_help = true)]
    format: Option<Format>,
    /// Background of transparent pixels: RRGGBB [default: ffffff]
    #[arg(long, value_name = "COLOUR", value_parser = numbers::colour, help_heading = ADVANCED, hide_short_help = true)]
    background: Option<[f32; 3]>,
    /// Turn the photos as their EXIF orientation says
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    exif_rotate: bool,
    /// Rig position of a Spaces scene
    #[arg(long, value_name = "INDEX", default_value_t = 0, help_heading = ADVANCED, hide_short_help = true)]
    rig_position: usize,
}

impl SceneArgs {
    /// The scene folder.
    pub(crate) fn folder(&self) -> &Path {
        &self.scene
    }

    /// Options for opening the scene.
    pub(crate) fn options(&self) -> SceneOptions {
        SceneOptions {
            width: self.width,
            format: self.format,
            background: self.background,
            exif_rotate: self.exif_rotate,
            images: self.images.clone(),
            rig_position: self.rig_position,
        }
    }

    /// The nearest and farthest depth given.
    pub(crate) fn depth(&self) -> (Option<f64>, Option<f64>) {
        (self.near, self.far)
    }

    /// Opens the scene.
    pub(crate) fn open(&self) -> Result<SceneViews> {
        self.open_at(None, self.depth())
    }

    /// Opens the scene at this width, unless `--width` is given, with a depth range (scene units).
    pub(crate) fn open_at(&self, width: Option<usize>, (near, far): (Option<f64>, Option<f64>)) -> Result<SceneViews> {
        let options = SceneOptions { width: self.width.or(width), ..self.options() };
        Ok(SceneViews::new(Scene::open(&self.scene, &options)?, near, far))
    }
}

/// Parses the name of a camera and what ffmpeg opens.
pub(crate) fn source(text: &str) -> Result<(String, PathBuf), String> {
    let parts = text.split_once('=').filter(|(name, url)| !name.is_empty() && !url.is_empty());
    let (name, url) = parts.ok_or("expected the name of a camera and what to open: cam00=rtsp://10.0.0.5/1")?;
    Ok((name.to_owned(), url.into()))
}
