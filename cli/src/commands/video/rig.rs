//! A folder with one folder of frames or one video file per camera, and poses in any format: opened as a scene whose photos
//! are stand-ins of the frames' size, one per camera.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::fs::bounded;
use liveview::image::encode;
use liveview::{ImageRgb, PhotoCache, Scene};
use serde_json::Value;

use super::feed::Feed;
use crate::args::scene::SceneArgs;
use crate::console::shown;

/// Folders of a rig that may hold its cameras.
const FOLDERS: [&str; 4] = ["", "images", "frames", "videos"];
/// JSON files that name photos, and the key they do it by.
const NAMED: [(&str, &str); 2] = [("transforms.json", "file_path"), ("models.json", "relative_path")];

/// A rig: the poses and what each delivers.
pub(super) struct Rig {
    pub(super) photos: PhotoCache,
    /// One per view of the scene.
    pub(super) feeds: Vec<Feed>,
}

impl Rig {
    /// Opens a rig; what was left out stands in the scene's notes.
    pub(super) fn open(args: &SceneArgs) -> Result<Self> {
        let root = args.folder();
        if !root.is_dir() {
            bail!("{}: expected the folder of a rig", root.display());
        }
        let mut feeds = find(root)?;
        let mut notes = Vec::new();
        let sizes: Vec<Option<(usize, usize)>> = feeds
            .iter()
            .map(|feed| {
                feed.size().map_err(|error| notes.push(format!("camera {} is left out: {error}", feed.name))).ok()
            })
            .collect();
        // Where every frame is numbered from 1, or from 100, that is the first.
        let first = feeds.iter().map(Feed::first).min().unwrap_or(0);
        feeds.iter_mut().for_each(|feed| feed.counted_from(first));

        let stand_ins = tempfile::tempdir()?;
        let cameras: Vec<(&Feed, (usize, usize))> =
            feeds.iter().zip(&sizes).filter_map(|(feed, size)| Some((feed, (*size)?))).collect();
        if cameras.len() < 2 {
            bail!("{}: {} of {} cameras can be read; expected 2 or more", root.display(), cameras.len(), feeds.len());
        }
        if cameras.len() < feeds.len() && root.join("poses_bounds.npy").is_file() {
            bail!("{}: poses_bounds.npy goes by the order of the cameras, but {}", root.display(), notes.join("; "));
        }
        lay_out(root, stand_ins.path(), &cameras, &mut notes)?;
        let mut scene = Scene::open(stand_ins.path(), &args.options()).map_err(|error| {
            // What was laid out speaks of where it came from.
            anyhow!(format!("{error:#}").replace(&shown(stand_ins.path()), &shown(root)))
        })?;
        root.clone_into(&mut scene.root);
        let names: Vec<&str> = scene.views.iter().map(|view| camera_of(&view.name)).collect();
        if let Some(posed) = cameras.iter().find(|(feed, _)| !names.contains(&feed.name.as_str())) {
            notes.push(format!("camera {} has no pose: left out", posed.0.name));
        }
        let feed = |name: &&str| feeds.iter().find(|feed| feed.name == *name).cloned();
        let feeds = names.iter().map(feed).collect::<Option<Vec<_>>>();
        let feeds = feeds.ok_or_else(|| anyhow!("{}: poses name photos that are no camera's", root.display()))?;
        for (view, feed) in scene.views.iter_mut().zip(&feeds) {
            view.name.clone_from(&feed.name);
        }
        scene.notes.retain(|note| !note.starts_with("photos are those of")); // the stand-ins'
        scene.notes.extend(notes);
        Ok(Self { photos: args.with_depth(scene), feeds })
    }
}

/// The first folder that holds cameras.
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

/// `cam00` of `cam00.png`, of `cam00/0000.jpg` and of `images/cam00/0000.jpg`.
fn camera_of(name: &str) -> &str {
    match name.rsplit_once('/') {
        Some((folder, _)) => folder.rsplit('/').next().unwrap_or(folder),
        None => name.rsplit_once('.').map_or(name, |(stem, _)| stem),
    }
}

/// Writes the poses and a black photo per camera where they expect one. Only its header is ever read.
fn lay_out(root: &Path, to: &Path, cameras: &[(&Feed, (usize, usize))], notes: &mut Vec<String>) -> Result<()> {
    let mut encoded = HashMap::new();
    let mut stand_in = |name: PathBuf, (width, height): (usize, usize)| -> Result<()> {
        fs::create_dir_all(name.parent().unwrap_or(to))?;
        let png = match encoded.entry((width, height)) {
            Entry::Occupied(png) => png.into_mut(),
            Entry::Vacant(none) => {
                none.insert(encode("a.png".as_ref(), &ImageRgb::new(width, height, vec![0.0; 3 * width * height])?)?)
            }
        };
        Ok(fs::write(name, png)?)
    };
    let mut known = false;
    for (name, key) in NAMED.iter().filter(|(name, _)| root.join(name).is_file()) {
        let path = root.join(name);
        let text = bounded::read(&path, bounded::MAX_JSON_BYTES).with_context(|| path.display().to_string())?;
        let mut json: Value =
            serde_json::from_slice(&text).map_err(|error| anyhow!("{}: not JSON: {error}", path.display()))?;
        let mut taken = Vec::new();
        rename(&mut json, key, cameras, &mut taken, notes);
        fs::write(to.join(name), json.to_string())?;
        for &(feed, size) in cameras.iter().filter(|(feed, _)| taken.contains(&feed.name)) {
            stand_in(to.join(format!("{}/0.png", feed.name)), size)?;
        }
        known = true;
    }
    if root.join("poses_bounds.npy").is_file() {
        fs::copy(root.join("poses_bounds.npy"), to.join("poses_bounds.npy"))?;
        cameras.iter().try_for_each(|(feed, size)| stand_in(to.join(format!("images/{}.png", feed.name)), *size))?;
        known = true;
    } else if let Some(model) = ["sparse/0", "sparse"].into_iter().find(|model| is_colmap(&root.join(model))) {
        fs::create_dir_all(to.join(model))?;
        for entry in fs::read_dir(root.join(model))? {
            let path = entry?.path();
            if let (true, Some(name)) = (path.is_file(), path.file_name()) {
                fs::copy(&path, to.join(model).join(name))?;
            }
        }
        // A model names its photos; each of these it may.
        for (feed, size) in cameras {
            let (name, file) = (&feed.name, feed.file_name());
            for name in [format!("{name}/{file}"), format!("{name}.png"), format!("{name}.jpg")] {
                let probe = to.join("images").join(name);
                stand_in(probe, *size)?;
            }
        }
        known = true;
    }
    if !known {
        bail!(
            "{}: no poses found; expected transforms.json, poses_bounds.npy, models.json or a COLMAP model in sparse/0",
            root.display()
        );
    }
    Ok(())
}

fn is_colmap(folder: &Path) -> bool {
    ["cameras.bin", "cameras.txt"].iter().any(|file| folder.join(file).is_file())
}

/// Points each entry at its camera's stand-in; entries of no camera, and second ones of the same, are taken out.
fn rename(
    json: &mut Value,
    key: &str,
    cameras: &[(&Feed, (usize, usize))],
    taken: &mut Vec<String>,
    notes: &mut Vec<String>,
) {
    match json {
        Value::Array(entries) => entries.retain_mut(|entry| {
            let Some(name) = entry.get(key).and_then(Value::as_str).map(str::to_owned) else {
                rename(entry, key, cameras, taken, notes);
                return true;
            };
            let of = |part: &str| {
                let stem = part.rsplit_once('.').map_or(part, |(stem, _)| stem);
                cameras.iter().find(|(feed, _)| feed.name == part || feed.name == stem)
            };
            let Some((feed, _)) = name.rsplit('/').find_map(of) else {
                notes.push(format!("{name} belongs to no camera: left out"));
                return false;
            };
            if taken.contains(&feed.name) {
                return false;
            }
            taken.push(feed.name.clone());
            entry[key] = Value::from(format!("{}/0.png", feed.name));
            true
        }),
        Value::Object(fields) => fields.values_mut().for_each(|value| rename(value, key, cameras, taken, notes)),
        _ => {}
    }
}
