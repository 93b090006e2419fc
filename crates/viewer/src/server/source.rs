//! What the worker computes: pictures, and the depth of photos, of a scene or of a time step of a rig.

use std::mem;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, anyhow};
use liveview::image::encode;
use liveview::render::Renderer;
use liveview_live::rig::Frames;
use liveview_live::session::CameraDepths;
use liveview_synthesizer::{Scene, ScenePhotos, SceneViews, Synthesizer, Targets, ViewAgreement, agreement};

use super::jobs::Viewpoint;
use crate::depth_code::DepthCode;

/// Steps of depth to a pixel of parallax, as in a baked page of full quality.
const DEPTH_STEPS: u16 = 16;

/// A synthesizer of a scene, or of the time step of a rig that was asked for last.
pub(crate) struct Source {
    pub(crate) synthesizer: Synthesizer,
    pub(crate) held_out: Vec<usize>,
    pub(crate) without_network: bool,
    pub(crate) note: fn(&str),
    pub(crate) rig: Option<Rig>,
}

/// A rig, of which one time step is open.
pub(crate) struct Rig {
    pub(crate) frames: Arc<Frames>,
    pub(crate) views: SceneViews,
    pub(crate) range: (f64, f64),
    /// The views that are not held out.
    pub(crate) free: Vec<usize>,
    /// The open time step.
    pub(crate) step: Option<usize>,
    /// The depth of the cameras' photos.
    pub(crate) depths: CameraDepths,
}

impl Source {
    /// A picture at full quality, as PNG: that of `liveview render --pose`.
    pub(crate) fn picture(&mut self, viewpoint: &Viewpoint) -> Result<Vec<u8>> {
        let held_out = self.open(viewpoint.step)?;
        let targets = Targets { held_out, ..Targets::cameras(vec![viewpoint.camera.clone()]) };
        let shot = self.synthesizer.shots(targets)?.remove(0);
        let loaded = self.synthesizer.load(&shot, &[])?;
        let plan = self.synthesizer.plan(&loaded)?;
        self.take_notes();
        let (frame, _) = agreement::render(&mut self.synthesizer, &loaded, &plan, self.without_network, &mut |_| ())?;
        Ok(encode(Path::new("picture.png"), &frame.picture())?)
    }

    /// The depth of a view's photo, as the page reads it. `later`: views whose depth is needed next.
    pub(crate) fn depth(&mut self, (view, step): (usize, usize), later: &[usize]) -> Result<Vec<u8>> {
        let (found, confirmed) = match &mut self.rig {
            None => {
                let depth = self.synthesizer.photos_mut().view_depth(view, &self.held_out, later, true)?;
                self.take_notes();
                (depth.found, depth.confirmed)
            }
            Some(rig) => {
                let photos = rig.frames.by_camera(step, &rig.free);
                rig.depths.confirmed(step, view, &photos).ok_or_else(|| anyhow!("no photo of camera {view}"))?
            }
        };
        Ok(DepthCode::new((&found, &confirmed), DEPTH_STEPS).compressed(1))
    }

    fn take_notes(&mut self) {
        self.synthesizer.photos_mut().take_notes().iter().for_each(|note| (self.note)(note));
    }

    /// Opens a time step, of the cameras that are not held out and delivered a photo. Returns the views that are held
    /// out of what is open.
    fn open(&mut self, step: usize) -> Result<Vec<usize>> {
        let Some(rig) = &mut self.rig else { return Ok(self.held_out.clone()) };
        if rig.step != Some(step) {
            let (scene, photos) = (rig.views.scene(), rig.frames.by_camera(step, &rig.free));
            let delivered = photos.into_iter().enumerate().filter_map(|(view, photo)| Some((view, photo?)));
            let named = |(view, photo): (usize, Arc<_>)| {
                (scene.views[view].name.clone(), Arc::unwrap_or_clone(photo), scene.views[view].camera.clone())
            };
            let opened = Scene::in_memory(delivered.map(named), &Default::default())?;
            let photos = ScenePhotos::new(SceneViews::new(opened, Some(rig.range.0), Some(rig.range.1)));
            rig.step = Some(step);
            // Its renderer moves on to the next.
            let placeholder = Renderer::new(Box::new(ViewAgreement { views: 1 }), ViewAgreement::ALPHA, 1);
            let mut next = Synthesizer::new(photos, placeholder, self.synthesizer.layers().clone());
            mem::swap(next.renderer_mut(), self.synthesizer.renderer_mut());
            next.photo_correction = self.synthesizer.photo_correction;
            self.synthesizer = next;
        }
        Ok(Vec::new())
    }
}

/// The photo of a view, at a time step of a rig, as JPEG.
pub(crate) fn photo(scene: &Scene, frames: Option<&Frames>, (view, step): (usize, usize)) -> Result<Vec<u8>> {
    let photo = match frames {
        None => Arc::new(scene.load_image(view)?),
        Some(frames) => {
            let read = frames.at(step, &[view]).pop().ok_or_else(|| anyhow!("no camera {view}"))?;
            read.map_err(|reason| anyhow!("{reason}"))?
        }
    };
    Ok(liveview::image::encode_with_quality(Path::new("photo.jpg"), &photo, crate::bake::QUALITIES[0].0)?)
}
