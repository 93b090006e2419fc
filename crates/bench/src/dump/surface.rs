//! The stages at the target of surface layers, from the depth of the photos on.

use anyhow::Result;
use liveview::geometry::distance;
use liveview::surface::{
    ConfirmedDepth, ConsistencyVotes, PhotoDepth, SurfaceView, TargetSurface, confirmed, exposure_gains, stages,
};
use liveview::warp::{NO_GAINS, SourceView, Texture};
use liveview::{Camera, LoadedShot, PhotoCorrection, Scene, Shot, Synthesizer};
use ndarray::{Array1, Array2};

use super::photos::Photos;
use super::search::write_search;
use crate::npz::Arrays;

/// Writes the depth of the photos and the surface at the target; with `search`, also how the depth
/// was found, and all photos.
pub(super) fn write_surface(
    job: &mut Synthesizer,
    loaded: &LoadedShot,
    surface: &TargetSurface,
    (correction, search): (PhotoCorrection, bool),
    arrays: &mut Arrays,
) -> Result<()> {
    let shot = loaded.shot();
    let photos = Photos::of(job, shot)?;
    let scene = job.scene();
    arrays.add("surface.range", Array1::from_vec(vec![photos.range.0, photos.range.1]))?;
    arrays
        .add("surface.corrected", ndarray::arr1(&[i64::from(correction.exposure), i64::from(correction.sharpness)]))?;
    for (index, depth) in photos.depths.iter().enumerate() {
        arrays.add(&format!("depth{index}"), depth.disparity.clone())?;
    }
    arrays.add("pixel", photos.depths.iter().map(|depth| depth.disparity_per_pixel).collect::<Array1<_>>())?;
    let written = |view: &usize| if search { !shot.held_out.contains(view) } else { photos.views.contains(view) };
    for view in (0..scene.views.len()).filter(written) {
        arrays.add(&format!("photo{view}.colours"), scene.load_image(view)?.as_array().to_owned())?;
    }
    write_at_target(scene, shot, &photos, surface, correction, arrays)?;
    if search { write_search(scene, shot, &photos, arrays) } else { Ok(()) }
}

fn write_at_target(
    scene: &Scene,
    shot: &Shot,
    photos: &Photos,
    surface: &TargetSurface,
    correction: PhotoCorrection,
    arrays: &mut Arrays,
) -> Result<()> {
    let cameras: Vec<&Camera> = photos.views.iter().map(|&view| &scene.views[view].camera).collect();
    let load = |&view: &usize| Ok(Texture::new(&scene.load_image(view)?));
    let textures = photos.views.iter().map(load).collect::<Result<Vec<_>>>()?;
    let view = |index: usize| SourceView { camera: cameras[index], texture: &textures[index] };
    let set: Vec<_> = photos.depths.iter().enumerate().map(|(index, depth)| (view(index), depth)).collect();
    let mut nearer = Vec::new();
    for (index, depth) in photos.depths.iter().enumerate() {
        let confirmed = confirmed_by_others(index, &cameras, &photos.depths);
        nearer.push(stages::nearer_edges(&set, index, &ConfirmedDepth::new(depth, &confirmed)));
        arrays.add(&format!("confirmed{index}"), confirmed.mapv(|yes| f32::from(u8::from(yes))))?;
    }
    // Those to render from as they were used; the helpers' are not kept.
    let used = surface.visibility();
    let of_photo = |index: usize| {
        let PhotoDepth { disparity_per_pixel, .. } = nearer[index];
        let used =
            used.disparities.get(index).map(|&used| ConfirmedDepth { disparity: used.clone(), disparity_per_pixel });
        used.unwrap_or_else(|| ConfirmedDepth::new(&nearer[index], &confirmed_by_others(index, &cameras, &nearer)))
    };
    let kept: Vec<ConfirmedDepth> = (0..cameras.len()).map(of_photo).collect();
    for (index, kept) in kept.iter().enumerate() {
        let mut nearer = nearer[index].disparity.clone();
        nearer.zip_mut_with(&kept.disparity, |nearer, &used| *nearer = if used < 0.0 { *nearer } else { used });
        arrays.add(&format!("nearer{index}"), nearer)?;
        arrays.add(&format!("sure{index}"), kept.disparity.mapv(|disparity| f32::from(disparity >= 0.0)))?;
    }
    let views = kept.iter().enumerate();
    let mut views: Vec<SurfaceView<'_>> =
        views.map(|(index, confirmed)| SurfaceView { view: view(index), confirmed, gains: NO_GAINS }).collect();
    let mut gains = vec![NO_GAINS; views.len()];
    if correction.exposure {
        let distances: Vec<f64> = cameras.iter().map(|camera| distance(camera, &shot.target)).collect();
        gains = exposure_gains(&views, &distances);
    }
    gains.iter_mut().zip(surface.corrections()).for_each(|(gains, view)| *gains = view.gains);
    views.iter_mut().zip(&gains).for_each(|(view, gains)| view.gains = *gains);
    arrays.add("gains", Array2::from_shape_fn((gains.len(), 3), |(view, channel)| gains[view][channel]))?;
    arrays.add("sharpening", surface.corrections().iter().map(|view| view.sharpening).collect::<Array1<_>>())?;
    let disparity_per_pixel = stages::target_disparity_per_pixel(&views, &shot.target, photos.range);
    let splat = stages::splatted(&views, &shot.target, disparity_per_pixel);
    arrays.add("filled", stages::fill_holes(&splat))?;
    arrays.add("splat", splat)?;
    arrays.add("surface", surface.surface().disparity.clone())
}

fn confirmed_by_others(index: usize, cameras: &[&Camera], depths: &[PhotoDepth]) -> Array2<bool> {
    let map = |which: usize| (cameras[which], &depths[which]);
    let others = (0..cameras.len()).filter(|&other| other != index);
    let votes: Vec<_> = others.map(|other| ConsistencyVotes::new(map(index), map(other))).collect();
    confirmed(&votes.iter().collect::<Vec<_>>(), depths[index].disparity.dim())
}
