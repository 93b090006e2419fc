//! `liveview dump`: every stage of one render as arrays, for `python -m liveview_ref.parity`.

mod photos;
mod scene;
mod search;
mod surface;

use std::path::Path;

use anyhow::{Result, ensure};
use liveview::layers::guided::SearchStages;
use liveview::layers::{Layer, Layers};
use liveview::network::Alpha;
use liveview::render::{Batch, Blended, Frame, LayerSamples, ViewCorrection};
use liveview::warp::warp_sources;
use liveview::{LayerSpec, LoadedShot, PhotoCorrection, Plan, Synthesizer};
use ndarray::{Array, Array1, Array2, Array3, Array4, ArrayD, ArrayView4, Axis, concatenate};

use crate::npz::Arrays;

/// The names of the arrays of [`Stages`].
const STAGES: [&str; 6] = ["maps", "colour", "coverage", "logits", "alpha", "rgb"];

/// The stages of all layers of a render, near → far.
#[derive(Default)]
struct Stages {
    /// Of each batch, in the order of [`STAGES`].
    batches: Vec<[ArrayD<f32>; STAGES.len()]>,
    logit_shift: Vec<f64>,
}

impl Stages {
    fn add(&mut self, batch: &Batch<'_>) {
        let (n, views, height, width) = batch.logits.dim();
        let (mut alpha, mut rgb) = (Vec::new(), Vec::new());
        let flat = |all: ArrayView4<'_, f32>, k: usize| all.index_axis(Axis(0), k).iter().copied().collect::<Vec<_>>();
        for k in 0..n {
            let (logits, colour) = (flat(batch.logits, k), flat(batch.hwv, k));
            let coverage = flat(batch.coverage, k);
            debug_assert_eq!(coverage.len(), views * height * width);
            let logit_shift = batch.logit_shifts[k];
            let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage, logit_shift };
            let mut blended = Blended::new(height * width);
            batch.weights.blend(&samples, 0, &mut blended);
            alpha.extend(blended.alpha);
            rgb.extend(blended.rgb.into_iter().flatten());
        }
        let alpha = Array::from_shape_vec((n, height, width), alpha).expect("one per pixel");
        let rgb = Array::from_shape_vec((n, 3, height, width), rgb).expect("three per pixel");
        self.batches.push([
            batch.disparity.to_owned().into_dyn(),
            batch.hwv.to_owned().into_dyn(),
            batch.coverage.to_owned().into_dyn(),
            batch.logits.to_owned().into_dyn(),
            alpha.into_dyn(),
            rgb.into_dyn(),
        ]);
        self.logit_shift.extend(batch.logit_shifts);
    }

    fn write(&self, arrays: &mut Arrays) -> Result<()> {
        for (stage, name) in STAGES.iter().enumerate() {
            let parts: Vec<_> = self.batches.iter().map(|batch| batch[stage].view()).collect();
            arrays.add(name, concatenate(Axis(0), &parts)?)?;
        }
        Ok(())
    }
}

/// Writes every stage of a shot to a .npz file; `of_surface`: the correction of the photos, and whether also how the depth of the
/// photos was found, and all photos.
pub fn write(
    synthesizer: &mut Synthesizer,
    shot: &LoadedShot,
    of_surface: (PhotoCorrection, bool),
    file: &Path,
    interrupted: fn() -> bool,
) -> Result<()> {
    let mut arrays = Arrays::create(file, interrupted)?;
    write_stages(synthesizer, shot, of_surface, &mut arrays)?;
    arrays.finish()
}

fn write_stages(
    job: &mut Synthesizer,
    shot: &LoadedShot,
    of_surface: (PhotoCorrection, bool),
    arrays: &mut Arrays,
) -> Result<()> {
    arrays.add_rig(job.views(), shot.shot())?;
    scene::write_scene(job.views(), shot.shot(), arrays)?;
    let plan = if let LayerSpec::Guided { layers, coarse_planes } = *job.layers() {
        let found = shot.search(coarse_planes)?;
        let layers = found.range.layers(layers)?;
        write_search(found, arrays)?;
        Plan::known(layers)
    } else {
        job.plan(shot)?
    };
    write_layers(&plan.layers, arrays)?;
    write_homography(&plan.layers, shot, arrays)?;
    if let Some(surface) = &plan.surface {
        surface::write_surface(job, shot, surface, of_surface, arrays)?;
    } else if !plan.corrections.is_empty() {
        write_corrections(&plan.corrections, arrays)?;
    }
    let mut stages = Stages::default();
    job.renderer_mut().set_skip_uncovered(false);
    let frame = job.render_plan(shot, &plan, Some(&mut |batch| stages.add(batch)))?;
    ensure!(!stages.batches.is_empty(), "{}: no view covers any of it", shot.shot().name);
    stages.write(arrays)?;
    match job.renderer().alpha() {
        Alpha::Competing { scale } => arrays.add("alpha_scale", Array1::from_vec(vec![scale]))?,
        Alpha::PerPixel { max_spacing } => {
            arrays.add("alpha_spacing", Array1::from_vec(vec![max_spacing]))?;
            arrays.add("logit_shift", Array1::from_vec(stages.logit_shift))?;
        }
        _ => (),
    }
    write_frame(frame, arrays)
}

/// Writes the exposure gains `[V, 3]` and the sharpening `[V]` of the views' photos.
fn write_corrections(corrections: &[ViewCorrection], arrays: &mut Arrays) -> Result<()> {
    let shape = (corrections.len(), 3);
    arrays.add("gains", Array2::from_shape_fn(shape, |(view, channel)| corrections[view].gains[channel]))?;
    arrays.add("sharpening", corrections.iter().map(|view| view.sharpening).collect::<Array1<_>>())
}

fn write_search(found: SearchStages, arrays: &mut Arrays) -> Result<()> {
    arrays.add("coarse_disparities", Array1::from_vec(found.disparities))?;
    arrays.add("costs", found.costs)?;
    arrays.add("aggregated_costs", found.aggregated_costs)?;
    arrays.add("coarse_disparity", found.coarse_disparity)?;
    arrays.add("fine_layers", found.fine_layers)?;
    arrays.add("fine_costs", found.fine_costs)?;
    arrays.add("fine_disparity", found.fine_disparity)?;
    let range = &found.range;
    let maps = [range.nearest(), range.surface(), range.farthest()].map(|map| map.view());
    arrays.add("range", ndarray::stack(Axis(0), &maps)?)
}

/// Writes the layers: planes or maps on cells.
fn write_layers(layers: &Layers, arrays: &mut Arrays) -> Result<()> {
    let map = |layer: &Layer| if let Layer::Map(map) = layer { Some(map.clone()) } else { None };
    let maps: Vec<_> = layers.as_slice().iter().filter_map(map).collect();
    if !maps.is_empty() {
        return arrays.add("cell_maps", ndarray::stack(Axis(0), &maps.iter().map(|m| m.view()).collect::<Vec<_>>())?);
    }
    let disparities = plane_disparities(layers);
    if disparities.is_empty() {
        // Layers given by pixel are written as the array `maps`.
        return Ok(());
    }
    arrays.add("disparities", Array1::from_vec(disparities))
}

fn plane_disparities(layers: &Layers) -> Vec<f64> {
    let plane = |layer: &Layer| if let Layer::Plane(disparity) = layer { Some(*disparity) } else { None };
    layers.as_slice().iter().filter_map(plane).collect()
}

/// Writes the homographies of planes, `[D, V, 3, 3]`; of layers that follow something, those of the
/// nearest and of the farthest depth.
fn write_homography(layers: &Layers, shot: &LoadedShot, arrays: &mut Arrays) -> Result<()> {
    let mut disparities = plane_disparities(layers);
    if disparities.is_empty() {
        disparities = vec![1.0 / shot.shot().near, 1.0 / shot.shot().far];
    }
    let sweeps: Vec<_> = warp_sources(&shot.sources(), &shot.shot().target).iter().map(|s| s.sweep).collect();
    let shape = (disparities.len(), sweeps.len(), 3, 3);
    let homography = Array4::from_shape_fn(shape, |(d, v, row, column)| {
        sweeps[v].source_from_target(disparities[d]).row(row)[column]
    });
    arrays.add("homography", homography)
}

fn write_frame(frame: Frame, arrays: &mut Arrays) -> Result<()> {
    let (height, width) = frame.disparity.dim();
    let picture = Array3::from_shape_fn((3, height, width), |(c, y, x)| frame.picture.pixel(x, y)[c]);
    arrays.add("frame", picture)?;
    arrays.add("disparity", frame.disparity)?;
    arrays.add("transmittance", frame.transmittance)?;
    arrays.add("best_layer", frame.best_layer.map(|best| best.map_or(-1, i64::from)))
}
