//! Whether the photos agree with their poses: how many pixels of a picture along the surface show the same colour in the photos
//! that it is blended from.
//!
//! Photos at a width of 200 pixels, the middle target of 14 ordinary scenes and the fountain; and with OpenCV's axes written into
//! their `transforms.json`, which has OpenGL's:
//!
//! | share of agreeing pixels | right | OpenCV's axes |
//! |---|---|---|
//! | all 15 scenes | 0.61 to 0.98 | 0.06 to 0.56 |
//! | lowest share with the right axes, vincent_a | 0.61 (0.65 at full size) | 0.16 |
//! | highest share with wrong axes, beer | 0.80 | 0.56 |
//! | hardly any texture, mouse | 0.77 | 0.46 |
//!
//! The share of the photos' depth that other photos confirm does not tell them apart (antonio_office 0.51 and 0.58, beer 0.54
//! and 0.54, bartoszek 0.33 and 0.10): depth is also confirmed where all photos find the same wrong one.

use anyhow::Result;
use liveview::ndarray::Axis;
use liveview::render::{Batch, Frame, Renderer};
use liveview_synthesizer::ViewAgreement;
use liveview_synthesizer::{
    LayerSpec, LoadedShot, Plan, SceneViews, SynthesisError, Synthesizer, TargetSurface, Targets,
};

/// Smallest share of agreeing pixels at which poses and photos count as matching.
const MIN_AGREEING: f64 = 0.58;
/// Agreement of the photos at a pixel, 0 to 1, above which they show the same colour there. Logit 0 is twice that.
const SAME_COLOUR: f32 = 0.7;
/// Only every so-many-th row is counted.
const ROW_STEP: usize = 4;

/// Counts the pixels at which photos agree.
#[derive(Debug, Clone, Copy, Default)]
struct Agreement {
    agreeing: usize,
    seen: usize,
}

impl Agreement {
    /// Counts the pixels that at least two photos see, on the middle one of layers along the surface; `batch` holds all layers,
    /// and its logits are those of [`ViewAgreement`].
    fn add(&mut self, batch: &Batch<'_>) {
        let middle = batch.logits.len_of(Axis(0)) / 2;
        let (logits, coverage) = (batch.logits.index_axis(Axis(0), middle), batch.coverage.index_axis(Axis(0), middle));
        let agreement = logits.index_axis(Axis(0), 0);
        for (y, row) in agreement.outer_iter().enumerate().step_by(ROW_STEP) {
            for (x, &logit) in row.iter().enumerate() {
                let views = (0..coverage.len_of(Axis(0))).filter(|&view| coverage[(view, y, x)] > 0.5).count();
                self.seen += usize::from(views > 1);
                self.agreeing += usize::from(views > 1 && logit > 2.0 * SAME_COLOUR);
            }
        }
    }

    /// The share of these pixels, 0 to 1; `None` if there are none.
    fn share(self) -> Option<f64> {
        (self.seen > 0).then(|| self.agreeing as f64 / self.seen as f64)
    }
}

/// Renders a shot on the layers of its plan, and the share of the pixels on which its photos agree: `None` with a network, and for
/// layers that are not along the surface. `observe` sees each batch of layers.
pub fn render(
    synthesizer: &mut Synthesizer,
    shot: &LoadedShot,
    plan: &Plan,
    without_network: bool,
    observe: &mut dyn FnMut(&Batch<'_>),
) -> Result<(Frame, Option<f64>), SynthesisError> {
    // The renderer shows up to three layers at once.
    let is_measured = without_network && plan.surface.is_some() && plan.layers.len() <= 3;
    let mut agreement = Agreement::default();
    let mut seen = |batch: &Batch<'_>| {
        observe(batch);
        if is_measured {
            agreement.add(batch);
        }
    };
    let frame = synthesizer.render_plan(shot, plan, Some(&mut seen))?;
    Ok((frame, agreement.share()))
}

/// What a low share usually means; `None` if it is not low.
pub fn warning(share: f64) -> Option<String> {
    (share < MIN_AGREEING).then(|| {
        format!(
            "the photos agree on only {:.0} % of the pixels: usually the axes of the poses follow another convention, the \
             intrinsics were given for another image size, or objects moved between the photos",
            100.0 * share
        )
    })
}

/// A held-out view along the surface of its `views` nearest photos: that surface, and the share of the pixels on which the
/// photos agree.
pub fn of_view(scene_views: &SceneViews, target: usize, views: usize) -> Result<(Option<TargetSurface>, Option<f64>)> {
    let (mut synthesizer, loaded, plan) = planned(scene_views, target, views)?;
    let (_, agreeing) = render(&mut synthesizer, &loaded, &plan, true, &mut |_| ())?;
    Ok((plan.surface, agreeing))
}

/// That surface alone, which is not rendered.
pub fn surface_of_view(scene_views: &SceneViews, target: usize, views: usize) -> Result<Option<TargetSurface>> {
    Ok(planned(scene_views, target, views)?.2.surface)
}

fn planned(scene_views: &SceneViews, target: usize, views: usize) -> Result<(Synthesizer, LoadedShot, Plan)> {
    let targets = Targets::held_out(scene_views.scene(), vec![target]);
    let renderer = Renderer::new(Box::new(ViewAgreement { views }), ViewAgreement::ALPHA, 1);
    let mut synthesizer = Synthesizer::new(scene_views.clone(), renderer, LayerSpec::Surface(1));
    let shot = synthesizer.shots(targets)?.remove(0);
    let loaded = synthesizer.load(&shot, &[])?;
    let plan = synthesizer.plan(&loaded)?;
    Ok((synthesizer, loaded, plan))
}
