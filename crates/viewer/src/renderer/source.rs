//! What pictures are rendered from.

use std::time::Duration;

use anyhow::Result;
use liveview::{Camera, Frame, ImageRgb, LayerSpec, Scene};

use crate::wish::Moment;

/// Time for one picture while something moves.
pub(super) const BUDGET: Duration = Duration::from_millis(50);

/// What pictures are rendered from: the photos of a scene, or the video of a rig.
pub(crate) trait Source {
    /// The photos with their cameras.
    fn scene(&self) -> &Scene;
    /// Scale of the target's sides for the next picture in motion.
    fn scale(&self, pixels: usize) -> f64;
    /// A picture while the viewpoint or time moves.
    fn in_motion(&mut self, at: &Moment) -> Result<Rendered>;
    /// Records how long a picture in motion took, with everything.
    fn note(&mut self, rendered: &Rendered, took: Duration);
    /// A picture at full quality.
    fn at_rest(&mut self, at: &Moment) -> Result<Rendered>;
    /// What a camera shows at a time step.
    fn photo(&mut self, view: usize, step: usize) -> Result<ImageRgb>;
    /// How often [`Self::prepare`] can do something.
    fn unprepared(&self) -> usize;
    /// Of these, what a first picture takes.
    fn needed_first(&self) -> usize;
    /// Does some work that pictures from near `at` are going to need.
    fn prepare(&mut self, at: &Camera) -> Result<()>;
}

/// A picture, and what there is to tell of it.
pub(crate) struct Rendered {
    pub(super) frame: Frame,
    /// Nearest and farthest depth, scene units.
    pub(super) range: (f64, f64),
    pub(super) layers: LayerSpec,
    /// Views that it was rendered from, and others that its surface was found with.
    pub(super) views: Vec<usize>,
    pub(super) helpers: Vec<usize>,
    /// Time for the photos, to find the layers, and to select planes.
    pub(super) before: [Duration; 3],
    /// Cameras that it was rendered without, and why.
    pub(super) left_out: Vec<String>,
}
