//! Which views a target is rendered from.

use crate::camera::Camera;
use crate::warp::Texture;

/// Optical axes further apart than this (60 degrees) look at different things.
const MIN_COSINE: f64 = 0.5;

/// A view ready to be warped.
#[derive(Debug, Clone, Copy)]
pub struct SourceView<'a> {
    /// Its camera; for an image of the texture's size.
    pub camera: &'a Camera,
    /// Its photo.
    pub texture: &'a Texture,
}

/// Too few views look the target's way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{wanted} views are needed, but only {found} of the {of} at hand look the target's way (axes within 60 degrees)"
)]
pub struct TooFewViews {
    /// V of the model.
    pub wanted: usize,
    /// How many qualify.
    pub found: usize,
    /// How many there are.
    pub of: usize,
}

/// Indices of the `count` cameras nearest to the target, nearest first (ties: the earlier), among those that look the same
/// way.
pub fn choose_views(cameras: &[&Camera], target: &Camera, count: usize) -> Result<Vec<usize>, TooFewViews> {
    let mut looking: Vec<usize> =
        (0..cameras.len()).filter(|&i| cameras[i].forward().dot(target.forward()) > MIN_COSINE).collect();
    if looking.len() < count {
        return Err(TooFewViews { wanted: count, found: looking.len(), of: cameras.len() });
    }
    looking.sort_by(|&a, &b| distance(cameras[a], target).total_cmp(&distance(cameras[b], target)));
    looking.truncate(count);
    Ok(looking)
}

/// Between the centres of two cameras, scene units.
pub fn distance(a: &Camera, b: &Camera) -> f64 {
    a.centre().distance(b.centre())
}
