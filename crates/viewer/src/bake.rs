//! A scene as one page that opens from a file: its photos, their depth, and all that draws them.

use std::path::Path;

use anyhow::{Result, bail};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use liveview::geometry::middle_camera;
use liveview::image::encode_with_quality;
use liveview_synthesizer::{Scene, ScenePhotos};
use rayon::prelude::*;
use serde_json::Value;

use crate::depth_code::DepthCode;
use crate::page::{description, page};

/// Qualities of JPEG, each with the steps of depth to a pixel of parallax: the first that fits is taken.
pub(crate) const QUALITIES: [(u8, u16); 4] = [(92, 16), (86, 8), (78, 4), (68, 2)];
/// Fewest photos to draw from.
const MIN_PHOTOS: usize = 2;

/// A page, and what it holds.
#[derive(Debug)]
pub struct Baked {
    /// The file.
    pub html: String,
    /// Number of photos in it.
    pub photos: usize,
    /// What was left out, a line each.
    pub notes: Vec<String>,
}

/// Bakes the photos of a scene, of at most `max_bytes`. `held_out`: views that are not drawn from, but compared with.
/// `found` is called after each photo's depth with the number found, and may end it by an error.
///
/// # Errors
///
/// A photo that cannot be read, an unknown depth range, or two photos that do not fit.
pub fn bake(
    photos: &mut ScenePhotos,
    held_out: &[usize],
    max_bytes: usize,
    mut found: impl FnMut(usize) -> Result<()>,
) -> Result<Baked> {
    let count = photos.views().scene().views.len();
    let free: Vec<usize> = (0..count).filter(|view| !held_out.contains(view)).collect();
    let start = start_view(photos.views().scene(), held_out)?;
    let mut depths: Vec<Option<DepthCode>> = (0..count).map(|_| None).collect();
    let mut range = (0.0, f64::INFINITY);
    for (index, &view) in free.iter().enumerate() {
        let depth = photos.view_depth(view, held_out, &free[index + 1..], true)?;
        range = depth.range;
        depths[view] = Some(DepthCode::new((&depth.found, &depth.confirmed), QUALITIES[0].1));
        found(index + 1)?;
    }
    let scene = photos.views().scene();
    let coded = |view: usize, (quality, steps): (u8, u16)| -> Result<(Value, Value)> {
        let jpeg = encode_with_quality(Path::new("photo.jpg"), &scene.load_image(view)?, quality)?;
        let depth = depths[view].as_ref().map(|depth| STANDARD.encode(depth.coarser(steps).compressed(9)));
        Ok((STANDARD.encode(jpeg).into(), depth.into()))
    };
    let mut kept: Vec<usize> = (0..count).collect();
    let mut qualities = QUALITIES.iter().peekable();
    loop {
        let quality = *qualities.next().expect("the last one stays");
        let data = kept.par_iter().map(|&view| coded(view, quality)).collect::<Result<Vec<_>>>()?;
        let mut described = description(scene, held_out, start, range);
        let views = described["views"].as_array_mut().expect("a list");
        let mut all = std::mem::take(views);
        *views = kept.iter().map(|&view| all[view].take()).collect();
        for (view, data) in views.iter_mut().zip(data) {
            (view["photo"], view["depth"]) = data;
        }
        described["start"] = kept.iter().position(|&view| view == start).into();
        let html = page(&described, false);
        if html.len() <= max_bytes {
            return Ok(baked(scene, html, &kept, quality));
        }
        if qualities.peek().is_none() {
            kept = fewer(&kept, held_out, start, max_bytes as f64 / html.len() as f64);
            if kept.iter().filter(|view| !held_out.contains(view)).count() < MIN_PHOTOS {
                bail!(
                    "--max-mb: two photos take more than {:.1} MB; expected more, or a smaller --width",
                    max_bytes as f64 / 1e6
                );
            }
            qualities = QUALITIES[QUALITIES.len() - 1..].iter().peekable();
        }
    }
}

/// Fewer of these views, by this share at least: those held out go first, then others evenly; `start` stays.
fn fewer(kept: &[usize], held_out: &[usize], start: usize, share: f64) -> Vec<usize> {
    let (held, free): (Vec<usize>, Vec<usize>) = kept.iter().partition(|view| held_out.contains(view));
    if !held.is_empty() {
        return free;
    }
    let most = ((free.len() as f64 * share * 0.98) as usize).min(free.len() - 1);
    // Evenly, beginning with `start`.
    let at = free.iter().position(|&view| view == start).unwrap_or(0);
    let mut left: Vec<usize> = (0..most).map(|i| free[(at + i * free.len() / most) % free.len()]).collect();
    left.sort_unstable();
    left
}

fn baked(scene: &Scene, html: String, kept: &[usize], (quality, steps): (u8, u16)) -> Baked {
    let mut notes = Vec::new();
    if (quality, steps) != QUALITIES[0] {
        notes.push(format!("photos as JPEG of quality {quality}, their depth to 1/{steps} pixel of parallax"));
    }
    let left_out = (0..scene.views.len()).filter(|view| !kept.contains(view));
    let left_out: Vec<&str> = left_out.map(|view| scene.views[view].name.as_str()).collect();
    if !left_out.is_empty() {
        notes.push(format!("left out, as the page would be too large (--max-mb): {}", left_out.join(", ")));
    }
    Baked { html, photos: kept.len(), notes }
}

/// The view in the middle of those that are not held out.
pub(crate) fn start_view(scene: &Scene, held_out: &[usize]) -> Result<usize> {
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !held_out.contains(view)).collect();
    let cameras: Vec<_> = free.iter().map(|&view| &scene.views[view].camera).collect();
    if cameras.is_empty() {
        bail!("every photo is held out; expected some to render from");
    }
    Ok(free[middle_camera(&cameras)])
}
