//! How well the views agree on a pixel's colour: logits without a network; and whether the photos agree with their poses: how many pixels of a picture along the surface show the
//! same colour in the photos that it is blended from (docs/design-log/ordinary-scenes.md).

use ndarray::{ArrayView2, ArrayView4, ArrayViewMut2, ArrayViewMut4, Axis};
use rayon::prelude::*;

use crate::{LayerSpec, LoadedShot, Plan, SceneViews, SynthesisError, Synthesizer, TargetSurface, Targets};
use liveview::network::{Alpha, NetworkError, PlaneNetwork};
use liveview::render::{Batch, Frame, Renderer};

/// Sum over the channels of the squared difference of two colours whose agreement is 1/2: 0.08 in
/// each channel.
const HALF_AGREEMENT: f32 = (3.0 * 0.08 * 0.08_f64) as f32;

/// Logit of full agreement.
const STRENGTH: f32 = 2.0;

/// Logits from how well the views agree on a pixel's colour; not in the paper.
///
/// A view that shows something else, because the surface is hidden from it, gets a lower weight;
/// where layers compete ([`Alpha::Competing`]), so does a layer that the views disagree on.
/// The agreement of a view is the mean, over the views that see the layer (itself included), of
/// 1 / (1 + (difference / 0.08)²), where the difference is the root mean square over the channels.
/// Logit 0 is twice the mean agreement of the views; logit v is twice the agreement of view v less
/// that of the first view. A view sees the layer where its coverage is above 0.
///
/// Along a surface it is the baseline that a network has to beat
/// (docs/design-log/surface-layers-limits.md).
#[derive(Debug, Clone, Copy)]
pub struct ViewAgreement {
    /// V.
    pub views: usize,
}

impl ViewAgreement {
    /// The layers that it recommends: three along the surface, which soften its edges. Agreement
    /// says little about which of several distant layers is the right one.
    pub const LAYERS: LayerSpec = LayerSpec::Surface(3);

    /// How its logits share a pixel.
    pub const ALPHA: Alpha = Alpha::Competing { scale: 1.0 };
}

impl PlaneNetwork for ViewAgreement {
    fn views(&self) -> usize {
        self.views
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        let layers = hwv.outer_iter().zip(coverage.outer_iter()).zip(logits.outer_iter_mut());
        for ((hwv, coverage), mut logits) in layers {
            let rows = hwv.axis_iter(Axis(1)).zip(coverage.axis_iter(Axis(1))).zip(logits.axis_iter_mut(Axis(1)));
            let rows: Vec<_> = rows.collect();
            rows.into_par_iter().for_each(|((hwv, coverage), logits)| row_logits(hwv, coverage, logits));
        }
        Ok(())
    }

    fn name(&self) -> String {
        "view agreement".to_owned()
    }
}

/// Logits `[V, w]` of a row `[3V, w]` of a layer, with its coverage `[V, w]`.
#[pulp::with_simd(row_logits = liveview::simd::arch())]
#[inline(always)]
fn row_logits_with<'a, S: pulp::Simd>(
    _simd: S,
    hwv: ArrayView2<'a, f32>,
    coverage: ArrayView2<'a, f32>,
    mut logits: ArrayViewMut2<'a, f32>,
) {
    let (views, width) = logits.dim();
    if logits.is_empty() {
        return;
    }
    let channels = |view: usize| -> [&[f32]; 3] {
        std::array::from_fn(|c| hwv.index_axis_move(Axis(0), 3 * view + c).to_slice().expect("standard layout"))
    };
    let (mut shown, mut agreement) = (vec![0.0_f32; width], vec![0.0_f32; views * width]);
    // 1 where a view sees the layer, else 0.
    let mut sees = vec![0.0; views * width];
    for (sees, coverage) in sees.chunks_exact_mut(width).zip(coverage.outer_iter()) {
        let coverage = coverage.to_slice().expect("standard layout");
        for x in 0..width {
            sees[x] = f32::from(u8::from(coverage[x] > 0.0));
            shown[x] += sees[x];
        }
    }
    for (view, agreement) in agreement.chunks_exact_mut(width).enumerate() {
        let [r, g, b] = channels(view);
        let own_sees = &sees[view * width..][..width];
        for other in 0..views {
            let [or, og, ob] = channels(other);
            let other_sees = &sees[other * width..][..width];
            for x in 0..width {
                let (own, others) = ([r[x], g[x], b[x]], [or[x], og[x], ob[x]]);
                let squares: f32 = own.iter().zip(&others).map(|(a, b)| (a - b) * (a - b)).sum();
                let difference = squares / HALF_AGREEMENT;
                agreement[x] += own_sees[x] * other_sees[x] / (1.0 + difference);
            }
        }
    }
    for x in 0..width {
        let count = shown[x].max(1.0);
        let strength = STRENGTH / count;
        let sum: f32 = (0..views).map(|view| agreement[view * width + x]).sum();
        logits[[0, x]] = strength * sum / count;
        for view in 1..views {
            logits[[view, x]] = strength * (agreement[view * width + x] - agreement[x]);
        }
    }
}

/// Smallest share of agreeing pixels at which poses and photos count as matching.
const MIN_AGREEING: f64 = 0.58;
/// Agreement of the photos at a pixel, 0 to 1, above which they show the same colour there. Logit 0 is twice that.
const SAME_COLOUR: f32 = 0.7;
/// Only every so-many-th row is counted.
const ROW_STEP: usize = 4;

/// Largest difference from the background of what shows it, in each channel: its exposure may be balanced.
const BACKGROUND_TOLERANCE: f32 = 0.04;

/// How many pixels at least two photos see, on the middle one of layers along the surface, and on how many of
/// these they agree; `batch` holds all layers, and its logits are those of [`ViewAgreement`]. Pixels where a photo
/// shows the background of transparent pixels do not count.
fn seen_and_agreeing(batch: &Batch<'_>, background: Option<[f32; 3]>) -> (usize, usize) {
    let middle = batch.logits.len_of(Axis(0)) / 2;
    let (logits, coverage) = (batch.logits.index_axis(Axis(0), middle), batch.coverage.index_axis(Axis(0), middle));
    let (mut seen, mut agreeing) = (0, 0);
    for (y, row) in logits.index_axis(Axis(0), 0).outer_iter().enumerate().step_by(ROW_STEP) {
        for (x, &logit) in row.iter().enumerate() {
            let seeing = || (0..coverage.len_of(Axis(0))).filter(|&view| coverage[(view, y, x)] > 0.5);
            let is_background = |view: usize, colour: [f32; 3]| {
                let value = |channel: usize| batch.hwv[(middle, 3 * view + channel, y, x)];
                (0..3).all(|channel| (value(channel) - colour[channel]).abs() < BACKGROUND_TOLERANCE)
            };
            if background.is_some_and(|colour| seeing().any(|view| is_background(view, colour))) {
                continue;
            }
            let views = seeing().count();
            seen += usize::from(views > 1);
            agreeing += usize::from(views > 1 && logit > 2.0 * SAME_COLOUR);
        }
    }
    (seen, agreeing)
}

/// Renders a shot on the layers of its plan, and the share of the pixels on which its photos agree: `None` with a network, and for
/// layers that are not along the surface. `observe` sees each batch of layers.
///
/// # Errors
///
/// Those of [`Synthesizer::render_plan`].
pub fn render(
    synthesizer: &mut Synthesizer,
    shot: &LoadedShot,
    plan: &Plan,
    without_network: bool,
    observe: &mut dyn FnMut(&Batch<'_>),
) -> Result<(Frame, Option<f64>), SynthesisError> {
    // The renderer shows up to three layers at once.
    let is_measured = without_network && plan.surface.is_some() && plan.layers.len() <= 3;
    let (mut seen, mut agreeing) = (0, 0);
    let background = synthesizer.scene().background();
    let mut count = |batch: &Batch<'_>| {
        observe(batch);
        let found = if is_measured { seen_and_agreeing(batch, background) } else { (0, 0) };
        (seen, agreeing) = (seen + found.0, agreeing + found.1);
    };
    let frame = synthesizer.render_plan(shot, plan, Some(&mut count))?;
    Ok((frame, (seen > 0).then(|| agreeing as f64 / seen as f64)))
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
///
/// # Errors
///
/// Those of [`Synthesizer::render`].
pub fn of_view(
    scene_views: &SceneViews,
    target: usize,
    views: usize,
) -> Result<(Option<TargetSurface>, Option<f64>), SynthesisError> {
    let targets = Targets::held_out(scene_views.scene(), vec![target]);
    let renderer = Renderer::new(Box::new(ViewAgreement { views }), ViewAgreement::ALPHA, 1);
    let mut synthesizer = Synthesizer::new(scene_views.clone(), renderer, LayerSpec::Surface(1));
    let shot = synthesizer.shots(targets)?.remove(0);
    let loaded = synthesizer.load(&shot, &[])?;
    let plan = synthesizer.plan(&loaded)?;
    let (_, agreeing) = render(&mut synthesizer, &loaded, &plan, true, &mut |_| ())?;
    Ok((plan.surface, agreeing))
}

#[cfg(test)]
mod tests {
    use ndarray::Array4;
    use ndarray::ArrayView4;

    use super::*;

    /// Logits of one pixel, from the grey of each view and its coverage.
    fn logits(greys: &[f32], coverage: &[f32]) -> Vec<f32> {
        let views = greys.len();
        let hwv: Vec<f32> = greys.iter().flat_map(|&grey| [grey; 3]).collect();
        let hwv = ArrayView4::from_shape((1, 3 * views, 1, 1), &hwv).unwrap();
        let coverage = ArrayView4::from_shape((1, views, 1, 1), coverage).unwrap();
        let mut logits = Array4::zeros((1, views, 1, 1));
        ViewAgreement { views }.infer(hwv, coverage, logits.view_mut()).unwrap();
        logits.into_raw_vec_and_offset().0
    }

    #[test]
    fn logits_of_agreeing_views_are_equal_and_of_a_differing_view_lower() {
        assert_eq!(logits(&[0.5; 4], &[1.0; 4]), [STRENGTH, 0.0, 0.0, 0.0]);
        let found = logits(&[0.5, 0.5, 0.58, 0.5], &[1.0; 4]);
        assert!((found[2] - STRENGTH * (2.5 - 3.5) / 4.0).abs() < 1e-5, "{found:?}");
        assert_eq!(found[1], 0.0);
        assert!((found[0] - STRENGTH * (3.0 * 3.5 + 2.5) / 16.0).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn views_that_do_not_see_the_layer_are_left_out_and_black_ones_are_not() {
        assert_eq!(logits(&[0.5, 0.0, 0.5], &[1.0, 0.0, 1.0])[..], [STRENGTH, -STRENGTH, 0.0]);
        assert_eq!(logits(&[0.0; 3], &[0.0; 3]), [0.0; 3]);
        assert_eq!(logits(&[0.0; 3], &[1.0; 3]), [STRENGTH, 0.0, 0.0]);
        assert_eq!(logits(&[0.7], &[1.0]), [STRENGTH]);
    }
}
