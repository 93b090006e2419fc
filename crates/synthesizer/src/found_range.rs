//! Photos from which the depth range of a scene is found ([`depth_range`]): a few groups of
//! neighbours, spread over the scene, at a small size.

use std::collections::{BTreeSet, HashMap};

use liveview::geometry::{Camera, CameraError, distance, facing_alike};
use liveview::warp::{SourceView, Texture};
use liveview_scene::{Scene, SceneError};
use liveview_surface::depth_range;
use rayon::prelude::*;

/// Groups of photos, evenly spread in the order of the views.
const GROUPS: usize = 4;
/// Photos of a group: one and its neighbours.
const GROUP_PHOTOS: usize = 5;
/// Photos are reduced by the whole factor that brings their longer side closest to this, pixels.
const SMALL_SIDE: f64 = 160.0;

/// Near and far (scene units) from the photos of these views, or of some of them; where they
/// confirm too little, the widest range that is possible. `None` if no two views have neighbouring
/// cameras in different places.
pub(crate) fn found_range(scene: &Scene, views: &[usize]) -> Result<Option<(f64, f64)>, SceneError> {
    let cameras: Vec<&Camera> = views.iter().map(|&view| &scene.views[view].camera).collect();
    let neighbours = |of: usize| -> Vec<usize> {
        facing_alike(&cameras, cameras[of]).into_iter().filter(|&other| other != of).collect()
    };
    // Nothing is much nearer than the cameras are to each other.
    let nearest = |of: usize| neighbours(of).first().map(|&other| distance(cameras[of], cameras[other]));
    let mut distances: Vec<f64> = (0..cameras.len()).filter_map(nearest).filter(|&distance| distance > 0.0).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let Some(&near) = distances.get(distances.len() / 2) else { return Ok(None) };

    let groups = GROUPS.min(cameras.len());
    let middles = (0..groups).map(|group| (2 * group + 1) * cameras.len() / (2 * groups));
    let groups: Vec<Vec<usize>> = middles
        .map(|middle| std::iter::once(middle).chain(neighbours(middle)).take(GROUP_PHOTOS).collect::<Vec<_>>())
        .filter(|group| group.len() > 1)
        .collect();
    let photos: BTreeSet<usize> = groups.iter().flatten().copied().collect();
    let load = |&photo: &usize| -> Result<_, SceneError> {
        let texture = Texture::new(&scene.load_image(views[photo])?);
        Ok((photo, reduced(&texture, cameras[photo])))
    };
    let small = photos.par_iter().map(load).collect::<Result<HashMap<_, _>, _>>()?;
    if small.values().any(Result::is_err) {
        return Ok(None);
    }
    let view = |photo: &usize| {
        let (camera, texture) = small[photo].as_ref().expect("checked above");
        SourceView { camera, texture }
    };
    let groups: Vec<Vec<SourceView<'_>>> = groups.iter().map(|group| group.iter().map(view).collect()).collect();
    Ok(Some(depth_range(&groups, near, f64::INFINITY).unwrap_or((near, f64::INFINITY))))
}

/// A photo and its camera at the small size.
fn reduced(photo: &Texture, camera: &Camera) -> Result<(Camera, Texture), CameraError> {
    let factor = (photo.width().max(photo.height()) as f64 / SMALL_SIDE).round().max(1.0) as usize;
    let texture = photo.shrunk(factor);
    Ok((camera.with_size_scaled(texture.width(), texture.height())?, texture))
}
