//! The views of a scene, and the choice among them: which a target is rendered from, and over which
//! range of depths; where a scene gives none, it is found from a few groups of neighbouring photos, spread
//! over the scene, at a small size ([`depth_range`]).

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::{Shot, SynthesisError, TargetCamera, Targets};
use liveview::geometry::{Camera, CameraError, choose_views, distance, facing_alike};
use liveview::layers::uniform_disparities;
use liveview::warp::{SourceView, Texture};
use liveview_scene::{Scene, SceneError};
use liveview_surface::depth_range;

/// A scene and the depth range given for it: chooses the views and the depth range of each target.
#[derive(Debug, Clone)]
pub struct SceneViews {
    /// Shared with searches on other threads.
    pub(crate) scene: Arc<Scene>,
    given: (Option<f64>, Option<f64>),
    /// The range found from the photos, once it was needed; `None` if it cannot be found.
    found: OnceLock<Option<(f64, f64)>>,
}

impl SceneViews {
    /// The views of a scene. `near` and `far` are in scene units; `None` takes the scene's own.
    pub fn new(scene: Scene, near: Option<f64>, far: Option<f64>) -> Self {
        Self { scene: Arc::new(scene), given: (near, far), found: OnceLock::new() }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Near and far as given to [`Self::new`], scene units.
    pub fn given_depth(&self) -> (Option<f64>, Option<f64>) {
        self.given
    }

    /// The cameras of all views.
    pub fn all_cameras(&self) -> Vec<&Camera> {
        self.scene.views.iter().map(|view| &view.camera).collect()
    }

    /// The cameras of these views.
    ///
    /// # Panics
    ///
    /// Iterating panics if there is no such view.
    pub fn cameras(&self, views: &[usize]) -> impl Iterator<Item = &Camera> {
        views.iter().map(|&view| &self.scene.views[view].camera)
    }

    /// The names of these views.
    ///
    /// # Panics
    ///
    /// If there is no such view.
    pub fn names(&self, views: &[usize]) -> Vec<&str> {
        views.iter().map(|&view| self.scene.views[view].name.as_str()).collect()
    }

    /// All views but those held out, here or by the scene.
    pub(crate) fn all_but(&self, held_out: &[usize]) -> Vec<usize> {
        let views = self.scene.views.iter().enumerate();
        views.filter(|(view, found)| !found.held_out && !held_out.contains(view)).map(|(view, _)| view).collect()
    }

    /// Indices of the `count` views to render the target from, nearest first, without those held out
    /// ([`choose_views`]); those in `kept` rather than others. `name` is the target's, for errors.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Views`] if fewer views face the target's direction.
    pub fn choose(
        &self,
        name: &str,
        target: &Camera,
        held_out: &[usize],
        count: usize,
        kept: &[usize],
    ) -> Result<Vec<usize>, SynthesisError> {
        let free = self.all_but(held_out);
        let cameras: Vec<&Camera> = self.cameras(&free).collect();
        let kept: Vec<usize> = (0..free.len()).filter(|&view| kept.contains(&free[view])).collect();
        let chosen = choose_views(&cameras, target, count, &kept).map_err(|source| SynthesisError::Views {
            target: format!("{}: {name}", self.scene.root.display()),
            source,
        })?;
        Ok(chosen.into_iter().map(|i| free[i]).collect())
    }

    /// Near and far in scene units: as given to [`Self::new`], else the extremes of these views'
    /// depth ranges, else as found from the scene's photos. Photos are loaded for that once, when
    /// it is first needed, and only those of views that are not held out then.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::UnknownDepth`] if one of them cannot be found; [`SynthesisError::Scene`] for a photo that cannot be read;
    /// [`SynthesisError::Layers`] unless 0 < near < far.
    ///
    /// # Panics
    ///
    /// If there is no such view.
    pub fn depth_range(&self, views: &[usize], held_out: &[usize]) -> Result<(f64, f64), SynthesisError> {
        let known = || views.iter().filter_map(|&view| self.scene.views[view].depth_range);
        let mut near = self.given.0.or_else(|| known().map(|range| range.0).reduce(f64::min));
        let mut far = self.given.1.or_else(|| known().map(|range| range.1).reduce(f64::max));
        if near.is_none() || far.is_none() {
            if self.found.get().is_none() {
                let _ = self.found.set(found_range(&self.scene, &self.all_but(held_out))?);
            }
            let found = self.found.get().copied().flatten();
            near = near.or(found.map(|range| range.0));
            far = far.or(found.map(|range| range.1));
        }
        let (Some(near), Some(far)) = (near, far) else {
            let (near, far) = (near.is_none(), far.is_none());
            return Err(SynthesisError::UnknownDepth { scene: self.scene.root.clone(), near, far });
        };
        uniform_disparities(near, far, 2)?;
        Ok((near, far))
    }

    /// Whether the range was found from the photos, since neither the options nor the scene give
    /// it.
    pub fn has_found_depth(&self) -> bool {
        self.found.get().is_some_and(Option::is_some)
    }

    /// Chooses the `count` views and the depth range of each target: `given` (near, far; scene
    /// units), or by [`Self::depth_range`]. The frames of a path share one range; that of a single
    /// target is refined for planes unless it is given, and a frame keeps the views of the one before unless
    /// others are clearly better. Each target also gets up to `helpers` further views.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Views`], and those of [`Self::depth_range`].
    pub fn shots(
        &self,
        targets: Targets,
        count: usize,
        helpers: usize,
        given: Option<(f64, f64)>,
    ) -> Result<Vec<Shot>, SynthesisError> {
        let held_out = &self.scene.with_held_out(targets.held_out.clone());
        let mut kept = Vec::new();
        let mut choose = |target: &TargetCamera| -> Result<(Vec<usize>, Vec<usize>), SynthesisError> {
            let choose = |count| self.choose(&target.name, &target.camera, held_out, count, &kept);
            let views = choose(count)?;
            let mut all = (1..=helpers).rev().find_map(|more| choose(count + more).ok()).unwrap_or_default();
            all.retain(|view| !views.contains(view));
            if targets.moving {
                kept.clone_from(&views);
            }
            Ok((views, all))
        };
        let views = targets.list.iter().map(&mut choose).collect::<Result<Vec<_>, _>>()?;
        let range = |views: &[usize]| given.map_or_else(|| self.depth_range(views, held_out), Ok);
        let all = || views.iter().flat_map(|(views, _)| views.iter().copied()).collect::<Vec<_>>();
        let shared = if targets.moving { Some(range(&all())?) } else { None };
        let shots = targets.list.iter().zip(&views).map(|(target, (views, helpers))| {
            let (near, far) = shared.map_or_else(|| range(views), Ok)?;
            Ok(Shot {
                name: target.name.clone(),
                target: target.camera.clone(),
                truth: target.truth,
                views: views.clone(),
                helpers: helpers.clone(),
                held_out: held_out.clone(),
                refines_range: !targets.moving && given.is_none() && self.given == (None, None),
                near,
                far,
            })
        });
        shots.collect()
    }
}

/// Groups of photos, evenly spread in the order of the views: as many as are needed for each photo to be in one, at most this many.
const MAX_GROUPS: usize = 4;
/// Photos of a group: one and its neighbours.
const GROUP_PHOTOS: usize = 5;
/// Photos are reduced by the whole factor that brings their longer side closest to this, pixels.
const SMALL_SIDE: f64 = 160.0;

/// Near and far (scene units) from the photos of these views, or of some of them; where they
/// confirm too little, the widest range that is possible. `None` if no two views have neighbouring
/// cameras in different places.
fn found_range(scene: &Scene, views: &[usize]) -> Result<Option<(f64, f64)>, SceneError> {
    let cameras: Vec<&Camera> = views.iter().map(|&view| &scene.views[view].camera).collect();
    let neighbours = |of: usize| -> Vec<usize> {
        facing_alike(&cameras, cameras[of]).into_iter().filter(|&other| other != of).collect()
    };
    // Nothing is much nearer than the cameras are to each other.
    let nearest = |of: usize| neighbours(of).first().map(|&other| distance(cameras[of], cameras[other]));
    let mut distances: Vec<f64> = (0..cameras.len()).filter_map(nearest).filter(|&distance| distance > 0.0).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let Some(&near) = distances.get(distances.len() / 2) else { return Ok(None) };

    let groups = cameras.len().div_ceil(GROUP_PHOTOS).min(MAX_GROUPS);
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
