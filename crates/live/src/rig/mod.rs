//! A camera rig: a folder with a folder of frames or a video file for each camera, and their poses in any format. It is opened as
//! a scene whose photos are the cameras' first frames.

mod feed;
mod frames;
mod source;
mod steps;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow, bail};
use liveview::Camera;
use liveview::geometry::choose_views;
use liveview::render::Renderer;
use liveview_scene::{SceneError, read_scene_json};
use liveview_synthesizer::{LayerSpec, Scene, SceneOptions, SceneViews};

use crate::ffmpeg::{FrameRate, is_address};
pub use feed::{Delivered, Feed, Reader};
use feed::{RigCamera, RigPhotos};
pub use frames::Frames;
use source::Origin;
pub use source::{Source, SourceClock, SourceCounts};
use steps::{align, match_rates};

/// Folders of a rig in which its cameras may lie.
const FOLDERS: [&str; 4] = ["", "images", "frames", "videos"];
/// Cameras that are read in addition to those that a frame needs, in case one delivers no photo.
pub const SPARE_CAMERAS: usize = 2;

/// The nearest and farthest depth given, scene units; the others are those of the scene.
pub type DepthRange = (Option<f64>, Option<f64>);

/// A rig: the poses of its cameras, and their frames.
#[derive(Debug)]
pub struct Rig {
    /// The poses, with the first frame of each camera as photos.
    pub views: SceneViews,
    /// The frames of each camera, in the order of the scene's views.
    pub feeds: Vec<Feed>,
}

impl Rig {
    /// Opens a rig, with sources some of whose cameras may run. The scene's notes say what was left out.
    ///
    /// # Errors
    /// Fewer than two readable cameras, no poses, a source that delivers no frame in time, or an error of the scene.
    pub fn open(
        folder: &Path,
        options: &SceneOptions,
        (near, far): DepthRange,
        sources: Option<&Sources>,
    ) -> Result<Self> {
        let (scene, feeds) = open_scene(folder, options, sources)?;
        Ok(Self { views: SceneViews::new(scene, near, far), feeds })
    }

    /// Opens a folder if it is a rig: with sources that are given, or that its `transforms.json` names where it has no frames; or
    /// several cameras, each with a folder or a video, at least one with several frames, and a single pose for each folder.
    ///
    /// # Errors
    /// Those of [`Self::open`], if there are videos or sources.
    pub fn find(folder: &Path, options: &SceneOptions, depth: DepthRange, sources: &Sources) -> Result<Option<Self>> {
        let feeds = find(folder).unwrap_or_default();
        if !sources.given.is_empty() || feeds.is_empty() && !sources.of_rig(folder)?.is_empty() {
            return Self::open(folder, options, depth, Some(sources)).map(Some);
        }
        if feeds.is_empty() || feeds.iter().all(|feed| feed.steps().is_some_and(|steps| steps < 2)) {
            return Ok(None);
        }
        if let Ok(scene) = Scene::open(folder, options)
            && !is_of_rig(&scene)
        {
            return Ok(None);
        }
        match Self::open(folder, options, depth, None) {
            Ok(rig) => Ok(Some(rig)),
            Err(error) if feeds.iter().any(Feed::is_video) => Err(error),
            // The error of opening it as a scene says more.
            Err(_) => Ok(None),
        }
    }

    /// Whether any of its cameras runs.
    pub fn is_running(&self) -> bool {
        self.feeds.iter().any(|feed| feed.source().is_some())
    }

    /// The number of time steps of these cameras.
    ///
    /// # Errors
    /// ffmpeg cannot read a video.
    pub fn steps(&self, cameras: &[usize]) -> Result<usize> {
        let steps = cameras.iter().map(|&camera| self.feeds[camera].count_steps());
        Ok(steps.collect::<Result<Vec<_>>>()?.into_iter().max().unwrap_or(0))
    }

    /// The lowest frame rate of its videos, which is that of its time steps; 30 per second without videos.
    ///
    /// # Errors
    /// ffmpeg cannot read a video.
    pub fn rate(&self) -> Result<FrameRate> {
        let rates = self.feeds.iter().map(Feed::rate).collect::<Result<Vec<_>>>()?;
        Ok(FrameRate::lowest(rates.into_iter().flatten()).unwrap_or(FrameRate { frames: 30, seconds: 1 }))
    }

    /// The cameras to read for these targets: for each the nearest of the `free` ones, `most` or as many as there are.
    ///
    /// # Errors
    /// Fewer than `fewest` cameras see what a target sees.
    pub fn cameras_for(
        &self,
        targets: &[Camera],
        free: &[usize],
        (fewest, most): (usize, usize),
    ) -> Result<Vec<usize>> {
        let cameras: Vec<&Camera> = self.views.cameras(free).collect();
        let mut chosen = BTreeSet::new();
        for target in targets {
            let views = (fewest..=most).rev().find_map(|count| choose_views(&cameras, target, count, &[]).ok());
            let views = views.map_or_else(|| choose_views(&cameras, target, fewest, &[]), Ok);
            chosen.extend(views.map_err(|error| anyhow!("{}: {error}", self.views.scene().root.display()))?);
        }
        Ok(chosen.into_iter().map(|camera| free[camera]).collect())
    }
}

/// The sources of a rig's cameras, in addition to those that its `transforms.json` names.
#[derive(Debug, Clone)]
pub struct Sources {
    /// The name of a camera, and what ffmpeg opens.
    pub given: Vec<(String, PathBuf)>,
    /// How their frames are matched.
    pub clock: SourceClock,
}

impl Sources {
    /// All of a rig. By frame numbers its cameras are read from its files: only those given are opened.
    fn of_rig(&self, root: &Path) -> Result<Vec<(String, PathBuf)>> {
        let mut found = self.given.clone();
        if self.clock == SourceClock::Frame {
            return Ok(found);
        }
        let file = root.join("transforms.json");
        // The reader of its poses says what is wrong with the file.
        let json = read_scene_json(&file).unwrap_or_default();
        for (index, frame) in json["frames"].as_array().into_iter().flatten().enumerate() {
            let Some(source) = frame.get("source") else { continue };
            let (Some(source), Some(photo)) = (source.as_str().map(Path::new), frame["file_path"].as_str()) else {
                bail!(
                    "{}: frames[{index}]: source: expected an address or a file, as text, and file_path, which names the camera",
                    file.display()
                );
            };
            let folder =
                Path::new(photo).parent().and_then(Path::file_name).filter(|name| FOLDERS.iter().all(|no| no != name));
            let name = folder.or(Path::new(photo).file_stem()).unwrap_or_default().to_string_lossy().into_owned();
            if found.iter().all(|(other, _)| *other != name) {
                found.push((name, if is_address(source) { source.to_owned() } else { root.join(source) }));
            }
        }
        Ok(found)
    }
}

/// A rig, and how its pictures are rendered.
#[derive(Debug)]
pub struct RigSettings {
    /// The cameras.
    pub rig: Rig,
    /// The networks, those of fewer views first; the last is the one that is used while all cameras deliver.
    pub renderers: Vec<Renderer>,
    /// Whether these are models, which predict opacities.
    pub with_models: bool,
    /// The layers.
    pub layers: LayerSpec,
    /// Whether the exposure of the photos is not balanced.
    pub keep_exposure: bool,
}

/// The scene of a rig's cameras, and the frames of each view.
fn open_scene(root: &Path, options: &SceneOptions, sources: Option<&Sources>) -> Result<(Scene, Vec<Feed>)> {
    if !root.is_dir() {
        let what = if root.exists() { "is a file" } else { "does not exist" };
        bail!("{}: {what}; expected the folder of a rig", root.display());
    }
    let running = sources.map(|sources| sources.of_rig(root)).transpose()?.unwrap_or_default();
    let found = find(root);
    let mut feeds = if running.is_empty() { found? } else { found.or_else(|_| Feed::all_in(root))? };
    feeds.retain(|feed| running.iter().all(|(name, _)| *name != feed.name));
    let origin = Arc::new(Origin::new());
    for (name, url) in running.iter().cloned() {
        feeds.push(Feed::open_source(name, url, sources.map_or(SourceClock::Frame, |sources| sources.clock), &origin));
    }
    feeds.sort_by(|a, b| a.name.cmp(&b.name));
    let mut notes = align(feeds.iter_mut().filter_map(Feed::photos_mut).collect());
    let (count, mut cameras, mut rates, mut left_out) = (feeds.len(), Vec::new(), Vec::new(), Vec::new());
    for feed in feeds {
        match feed.first_frame().and_then(|first| Ok((feed.rate()?, first))) {
            Ok((rate, (first, size))) => {
                rates.extend(rate.map(|rate| (feed.name.clone(), rate)));
                // Beside a source there may be anything: no folder of the scene.
                let first =
                    if running.iter().any(|(name, _)| *name == feed.name) { root.join(&feed.name) } else { first };
                cameras.push(RigCamera { feed, first, size });
            }
            Err(error) if feed.source().is_some() => return Err(error.context(format!("camera {}", feed.name))),
            Err(error) => left_out.push(format!("camera {} is left out: {error:#}", feed.name)),
        }
    }
    if cameras.len() < 2 {
        let (root, read) = (root.display(), cameras.len());
        bail!("{root}: {read} of {count} cameras can be read; expected 2 or more; {}", left_out.join("; "));
    }
    if cameras.len() < count && root.join("poses_bounds.npy").is_file() {
        bail!(
            "{}: poses_bounds.npy lists its poses in the order of the cameras, but {}",
            root.display(),
            left_out.join("; ")
        );
    }
    notes.extend(left_out);
    notes.extend(match_rates(cameras.iter_mut().map(|camera| &mut camera.feed), &rates));
    let photos = Arc::new(RigPhotos { cameras });
    let mut scene = Scene::open_with(root, photos.clone(), options).map_err(|error| match error {
        SceneError::NoScene { .. } => anyhow!(
            "{}: no poses found; expected transforms.json, poses_bounds.npy, models.json or a COLMAP model in sparse/0",
            root.display()
        ),
        SceneError::NoViews { path } => anyhow!(
            "{}: none of its {} cameras has a pose in {}; expected a rig, with a folder of frames or a video for each camera; \
             a scene of photos is for `liveview render`",
            root.display(),
            photos.cameras.len(),
            path.display()
        ),
        error => error.into(),
    })?;
    let is_posed = |camera: &&RigCamera| scene.views.iter().any(|view| view.name == camera.feed.name);
    let unposed = photos.cameras.iter().filter(|camera| !is_posed(camera));
    if let Some(camera) = unposed.clone().find(|camera| camera.feed.source().is_some()) {
        bail!("{}: camera {} has a source but no pose; expected a pose for each", root.display(), camera.feed.name);
    }
    notes.extend(unposed.map(|camera| format!("camera {} has no pose: left out", camera.feed.name)));
    scene.notes.extend(notes);
    let feed = |name: &str| photos.named(name).expect("views are named after their cameras").feed.clone();
    let feeds = scene.views.iter().map(|view| feed(&view.name)).collect();
    Ok((scene, feeds))
}

/// Whether a scene's photos lie in several folders, with a single pose for each folder.
fn is_of_rig(scene: &Scene) -> bool {
    let mut folders: BTreeMap<&Path, &Camera> = BTreeMap::new();
    let single_pose = scene.views.iter().all(|view| {
        let folder = view.image_path().parent().unwrap_or(Path::new(""));
        *folders.entry(folder).or_insert(&view.camera) == &view.camera
    });
    single_pose && folders.len() > 1
}

/// The cameras in the first folder that holds several.
fn find(root: &Path) -> Result<Vec<Feed>> {
    for folder in FOLDERS.map(|folder| root.join(folder)).iter().filter(|folder| folder.is_dir()) {
        let feeds = Feed::all_in(folder)?;
        if feeds.len() >= 2 {
            return Ok(feeds);
        }
    }
    bail!(
        "{}: no rig found; expected a folder of frames or a video file for each of 2 or more cameras, and their poses",
        root.display()
    )
}

#[cfg(test)]
mod tests {
    use std::fs;

    use liveview::ImageRgb;
    use tempfile::{TempDir, tempdir};

    use super::*;

    const COLMAP_CAMERA: &str = "1 PINHOLE 8 6 8 8 4 3\n";

    /// Three cameras, `a`, `a.0` and `c`, with two frames of 8x6 pixels each, and a file of poses.
    fn rig(poses: &str, text: &str) -> TempDir {
        let root = tempdir().unwrap();
        let photo = ImageRgb::new(8, 6, vec![0.5; 3 * 8 * 6]).unwrap();
        for frame in ["a/1.png", "a/2.png", "a.0/1.png", "a.0/2.png", "c/1.png", "c/2.png"] {
            write(&root, frame, b"");
            photo.save(root.path().join(frame)).unwrap();
        }
        write(&root, poses, text.as_bytes());
        root
    }

    fn write(root: &TempDir, name: &str, bytes: &[u8]) {
        let path = root.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    fn transforms(names: &[&str]) -> String {
        let pose = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]";
        let frame = |name: &&str| format!(r#"{{"file_path": "{name}", "transform_matrix": {pose}}}"#);
        let frames = names.iter().map(frame).collect::<Vec<_>>().join(", ");
        format!(r#"{{"fl_x": 8, "w": 8, "h": 6, "frames": [{frames}]}}"#)
    }

    fn opened(root: &TempDir) -> (Vec<String>, Vec<String>) {
        let (scene, feeds) = open_scene(root.path(), &SceneOptions::default(), None).unwrap();
        let names: Vec<String> = scene.views.iter().map(|view| view.name.clone()).collect();
        assert_eq!(names, feeds.iter().map(|feed| feed.name.clone()).collect::<Vec<_>>());
        assert!(scene.views.iter().all(|view| view.image_path().ends_with(format!("{}/1.png", view.name))));
        assert_eq!((scene.load_image(0).unwrap().width(), scene.load_image(0).unwrap().height()), (8, 6));
        (names, scene.notes)
    }

    #[test]
    fn sources_are_read_from_json_that_people_changed() {
        let root = tempfile::tempdir().unwrap();
        let text = "\u{feff}{\"frames\": [ // a comment\n{\"file_path\": \"cam0/1.jpg\", \"source\": \"udp://h:1\"},]}";
        fs::write(root.path().join("transforms.json"), text).unwrap();
        let sources = |clock| Sources { given: Vec::new(), clock }.of_rig(root.path()).unwrap();
        assert_eq!(sources(SourceClock::Arrival), [("cam0".to_owned(), "udp://h:1".into())]);
        assert_eq!(sources(SourceClock::Frame), []);
    }

    #[test]
    fn scene_with_one_pose_for_each_folder_is_a_rig() {
        let opened = |root: &TempDir| Scene::open(root.path(), &SceneOptions::default()).unwrap();
        let root = rig("transforms.json", &transforms(&["a/1.png", "a/2.png", "c/1.png"]));
        assert!(is_of_rig(&opened(&root)), "every frame is listed, and no camera moves");
        let moving = transforms(&["a/1.png", "a/2.png", "c/1.png"]).replacen("[1, 0, 0, 0]", "[1, 0, 0, 3]", 1);
        assert!(!is_of_rig(&opened(&rig("transforms.json", &moving))), "a moving camera");
        assert!(!is_of_rig(&opened(&rig("transforms.json", &transforms(&["a/1.png", "a/2.png"])))), "one folder");
    }

    #[test]
    fn entry_of_any_frame_names_its_camera() {
        let names = ["../rig/images/a.0/2.png", "a.0/1.png", "a.mp4", "other/1.png", "/far/away/c"];
        let (names, notes) = opened(&rig("transforms.json", &transforms(&names)));
        assert_eq!(names, ["a", "a.0", "c"]);
        assert_eq!(notes, ["other/1.png belongs to no camera: skipped"]);
    }

    #[test]
    fn ignored_entries_are_not_validated() {
        let text = transforms(&["a", "a.0", "c"]).replace("[{", "[{\"file_path\": \"other\", \"is_fisheye\": true}, {");
        let (names, notes) = opened(&rig("transforms.json", &text));
        assert_eq!((names.len(), notes), (3, vec!["other belongs to no camera: skipped".to_owned()]));
    }

    #[test]
    fn cameras_without_pose_or_frame_are_noted() {
        let root = rig("transforms.json", &transforms(&["a/1.png", "a.0/1.png"]));
        let (names, notes) = opened(&root);
        assert_eq!((names.len(), notes), (2, vec!["camera c has no pose: left out".to_owned()]));
        ["c/1.png", "c/2.png"].into_iter().for_each(|frame| write(&root, frame, b"no picture"));
        let (_, notes) = opened(&root);
        assert!(notes.len() == 1 && notes[0].starts_with("camera c is left out: "), "{notes:?}");
        // A RealEstate10K file does not describe a rig.
        fs::rename(root.path().join("transforms.json"), root.path().join("cameras.txt")).unwrap();
        let error = open_scene(root.path(), &SceneOptions::default(), None).unwrap_err().to_string();
        assert!(error.contains("no poses found; expected transforms.json"), "{error}");
    }

    #[test]
    fn colmap_may_name_frames_or_cameras() {
        for names in [["a/1.png", "a.0/1.png", "c/1.png"], ["a.png", "a.0.jpg", "c.png"]] {
            let root = rig("sparse/0/cameras.txt", COLMAP_CAMERA);
            let line = |(i, name): (usize, &&str)| format!("{i} 1 0 0 0 {i} 0 0 1 {name}\n\n");
            let images: String = names.iter().enumerate().map(line).collect();
            write(&root, "sparse/0/images.txt", images.as_bytes());
            assert_eq!(
                opened(&root),
                (
                    ["a", "a.0", "c"].map(str::to_owned).to_vec(),
                    vec!["no points3D, which would give the depth range".to_owned()]
                )
            );
        }
    }
}
