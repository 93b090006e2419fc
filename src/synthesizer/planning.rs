//! From a shot to its plan: the layers, and what the photos' depth says for planes.

use std::time::{Duration, Instant};

use super::error::SynthesisError;
use super::plan::Plan;
use super::scene_synthesizer::Synthesizer;
use super::shot::LoadedShot;
#[cfg(feature = "surface")]
use crate::kinds::PhotosWithDepth;
use crate::kinds::{Carried, FrameInput, Reuse, find_layers};
use crate::layers::{LayerSpec, Layers};
use crate::render::ViewCorrection;
#[cfg(feature = "surface")]
use crate::surface::{PhotoCorrection, TargetSurface};

impl Synthesizer {
    /// Whether it needs the depth of the photos: for surface layers, and for planes unless photos stay
    /// as they are ([`Self::set_photo_correction`]); guided layers do without.
    pub fn uses_depth(&self) -> bool {
        match &self.layers {
            LayerSpec::Guided { .. } => false,
            #[cfg(feature = "surface")]
            LayerSpec::Surface(_) => true,
            LayerSpec::Planes(_) | LayerSpec::List(_) | LayerSpec::Select { .. } => {
                #[cfg(feature = "surface")]
                let is_corrected = self.photo_correction != PhotoCorrection::NONE;
                #[cfg(not(feature = "surface"))]
                let is_corrected = false;
                is_corrected
            }
        }
    }

    /// Finds the layers of a shot.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Layers`]; [`SynthesisError::Render`] where planes are selected from a
    /// render; [`SynthesisError::Scene`] where a photo is needed for its depth and cannot be read.
    pub fn plan(&mut self, shot: &LoadedShot) -> Result<Plan, SynthesisError> {
        let started = Instant::now();
        let (corrections, (near, far)) = self.for_planes(shot)?;
        let input = FrameInput {
            target: &shot.shot().target,
            near,
            far,
            sources: &shot.sources(),
            is_followed: false,
            #[cfg(feature = "surface")]
            photo_correction: self.photo_correction,
            #[cfg(feature = "surface")]
            searches_holes: self.searches_holes,
        };
        let mut found = find_layers::<SynthesisError>(
            &self.layers,
            &mut Carried::default(),
            &input,
            Reuse::Nothing,
            // The photos of a scene do not change, nor does their depth.
            #[cfg(feature = "surface")]
            |_| self.photos.with_depth(shot),
        )?;
        let selection = found.selection.take();
        let mut plan = Plan::found(found, started.elapsed());
        if !corrections.is_empty() {
            plan = Plan { corrections, search: started.elapsed(), ..plan };
        }
        let Some(selection) = selection else { return Ok(plan) };
        let started = Instant::now();
        let frame = self.render_plan(shot, &plan, None)?;
        let layers = selection.planes(&frame, self.renderer.alpha())?;
        Ok(Plan { layers, selection: started.elapsed(), ..plan })
    }

    /// A plan of planes that are known already, such as those that an earlier frame selected.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] where a photo is needed for its depth and cannot be read.
    pub fn plan_on(&mut self, shot: &LoadedShot, planes: Layers) -> Result<Plan, SynthesisError> {
        let started = Instant::now();
        let (corrections, _) = self.for_planes(shot)?;
        let search = if corrections.is_empty() { Duration::ZERO } else { started.elapsed() };
        Ok(Plan { corrections, search, ..Plan::known(planes) })
    }

    /// What the photos' depth says for planes: how their photos are corrected, and between which depths
    /// (near, far; scene units) they lie.
    fn for_planes(&mut self, shot: &LoadedShot) -> Result<(Vec<ViewCorrection>, (f64, f64)), SynthesisError> {
        let range = (shot.shot().near, shot.shot().far);
        #[cfg(feature = "surface")]
        if self.uses_depth() && self.layers.kind() != "surface" {
            let PhotosWithDepth { maps, photos, rendered_from, .. } = self.photos.with_depth(shot)?;
            let (target, correction) = (&shot.shot().target, self.photo_correction);
            let refines = shot.shot().refines_range;
            // Of the surface, only the range depends on its holes.
            let searches_holes = self.searches_holes && refines;
            let surface = TargetSurface::find(maps, &photos, rendered_from, target, correction, searches_holes);
            let range = if refines { surface.seen_range(range) } else { range };
            return Ok((surface.corrections().to_vec(), range));
        }
        Ok((Vec::new(), range))
    }

    /// How many pixels of a shot have each of these planes (1/scene unit, near → far) as their best
    /// one: the paper's histogram, of the photos as they are.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Layers`] and [`SynthesisError::Render`].
    pub fn histogram(&mut self, shot: &LoadedShot, disparities: &[f64]) -> Result<Vec<u64>, SynthesisError> {
        let plan = Plan::known(Layers::planes(disparities)?);
        Ok(self.render_plan(shot, &plan, None)?.plane_histogram(disparities.len()))
    }
}
