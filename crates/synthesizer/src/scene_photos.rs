//! The photos of a scene that are needed in memory, and which of them, and of their depths, stay from
//! one target to the next.
//!
//! What the target and the one after it need stays. Of the rest, as much as fits into a fixed
//! number of bytes: first depths, which take longest to find and least to keep, then photos; of
//! each, those needed sooner before those needed later, and depths that no known target needs after
//! these, last used first. What is dropped is found again when it is needed, the same bit for bit.

use std::collections::HashSet;
use std::fmt;
use std::sync::Arc;

use liveview::warp::Texture;
use liveview_scene::SceneError;
use rayon::prelude::*;

use crate::photo_depths::{DepthFiles, OnSearch, SceneDepth};
use crate::shot::LoadedPhoto;
use crate::{LoadedShot, SceneViews, Shot, SynthesisError};

/// The photos of a scene and their depth: what a shot needs is loaded, and dropped when no later
/// shot needs it.
pub struct ScenePhotos {
    pub(crate) views: SceneViews,
    /// Of each view, if it is in memory.
    pub(crate) textures: Vec<Option<Arc<Texture>>>,
    /// The depths in memory, with the views of the last shot held out.
    pub(crate) depth: Option<SceneDepth>,
    /// The folder that keeps depths from run to run, if there is one.
    pub(crate) files: Option<DepthFiles>,
    pub(crate) progress: Option<OnSearch>,
    /// Views that targets so far were rendered with, last used first.
    recent: Vec<usize>,
    /// Bytes kept beyond what the target and the next one need.
    pub(crate) kept_bytes: usize,
}

impl From<SceneViews> for ScenePhotos {
    fn from(views: SceneViews) -> Self {
        Self::new(views)
    }
}

impl fmt::Debug for ScenePhotos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ScenePhotos").field("scene", &self.views.scene().root).finish_non_exhaustive()
    }
}

impl ScenePhotos {
    /// Bytes of photos and depths that [`Self::load`] keeps beyond what the target and the next one
    /// need.
    pub const KEPT_BYTES: usize = 128 << 20;

    /// The photos of these views, of which none is loaded yet.
    pub fn new(views: SceneViews) -> Self {
        let textures = vec![None; views.scene().views.len()];
        let kept_bytes = Self::KEPT_BYTES;
        Self { views, textures, depth: None, files: None, progress: None, recent: Vec::new(), kept_bytes }
    }

    /// The views, to choose among them.
    pub fn views(&self) -> &SceneViews {
        &self.views
    }

    /// Loads the photos of a shot of this scene. `later` are the shots that follow, in order: of
    /// the photos and depths in memory, those that the first of them needs stay, others within 128
    /// MiB, those needed sooner first; photos that no later shot needs are dropped.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read.
    pub fn load(&mut self, shot: &Shot, later: &[Shot]) -> Result<LoadedShot, SynthesisError> {
        self.drop_unneeded(shot, later);
        let photos = self.load_views(&shot.photos().collect::<Vec<_>>())?;
        Ok(LoadedShot { shot: shot.clone(), photos })
    }

    /// The photos of these views, those that are not in memory read from their files side by side. Of
    /// several errors it is the first view's.
    pub(crate) fn load_views(&mut self, views: &[usize]) -> Result<Vec<LoadedPhoto>, SceneError> {
        let load = |&view: &usize| LoadedPhoto::read(self.views.scene(), view, self.textures[view].as_ref());
        let loaded: Vec<_> = views.par_iter().map(load).collect();
        let store = |photo: Result<LoadedPhoto, SceneError>| {
            photo.inspect(|photo| self.textures[photo.view] = Some(Arc::clone(&photo.texture)))
        };
        loaded.into_iter().map(store).collect()
    }

    /// Drops what the shot does not need, and of what `later` shots need that which exceeds the
    /// limit.
    fn drop_unneeded(&mut self, shot: &Shot, later: &[Shot]) {
        // Views in the order in which they are needed, each once.
        let (mut order, mut listed) = (Vec::new(), HashSet::new());
        let next = later.iter().take(1).flat_map(Shot::photos);
        order.extend(shot.photos().chain(next).filter(|&view| listed.insert(view)));
        let soon = order.len();
        order.extend(later.iter().skip(1).flat_map(Shot::photos).filter(|&view| listed.insert(view)));
        let ever = order.len();
        // Then those that no known target needs: later targets may not be known yet.
        order.extend(self.recent.iter().copied().filter(|&view| listed.insert(view)));

        let mut left = self.kept_bytes;
        let mut fits = |bytes: usize| left.checked_sub(bytes).inspect(|&rest| left = rest).is_some();
        let kept = order.iter().enumerate().filter(|&(rank, &view)| rank < soon || fits(self.depth_bytes(view)));
        let kept: Vec<usize> = kept.map(|(_, &view)| view).collect();
        if let Some(depth) = &mut self.depth {
            depth.maps.retain(&kept, &order[..soon]);
        }
        let ever = order[..ever].iter().enumerate();
        let kept = ever.filter(|&(rank, &view)| rank < soon || fits(self.photo_bytes(view)));
        let kept: HashSet<usize> = kept.map(|(_, &view)| view).collect();
        self.retain_photos(|view| kept.contains(&view));

        self.recent.retain(|&view| !shot.photos().any(|needed| needed == view));
        self.recent.splice(..0, shot.photos());
    }

    /// Drops the photos of all views but those that `keep` names.
    pub(crate) fn retain_photos(&mut self, keep: impl Fn(usize) -> bool) {
        let dropped = self.textures.iter_mut().enumerate().filter(|(view, _)| !keep(*view));
        dropped.for_each(|(_, texture)| *texture = None);
    }

    /// Bytes of a view's photo; 0 if it is not in memory.
    fn photo_bytes(&self, view: usize) -> usize {
        self.textures[view].as_ref().map_or(0, |texture| texture.bytes())
    }

    /// Bytes of the depth of a view's photo; 0 if it is not in memory.
    pub(crate) fn depth_bytes(&self, view: usize) -> usize {
        self.depth.as_ref().map_or(0, |depth| depth.bytes(view))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::agreement::ViewAgreement;
    use crate::scene_views::SceneViews;
    use crate::shot::Target;
    use crate::shot::Targets;
    use crate::synthesizer::Synthesizer;
    use liveview::ImageRgb;
    use liveview::render::Renderer;
    use liveview_scene::Scene;
    use liveview_scene::SceneOptions;

    fn synthesizer(kept_bytes: usize) -> Synthesizer {
        let options = SceneOptions { width: Some(96), ..SceneOptions::default() };
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/scenes/workshop");
        let views = SceneViews::new(Scene::open(&folder, &options).unwrap(), None, None);
        let renderer = Renderer::new(Box::new(ViewAgreement { views: 1 }), ViewAgreement::ALPHA, 1);
        let mut synthesizer = Synthesizer::new(views, renderer, "surface:1".parse().unwrap());
        synthesizer.photos_mut().kept_bytes = kept_bytes;
        synthesizer
    }

    /// Photos in memory, and photos whose depth is.
    fn held(synthesizer: &mut Synthesizer) -> [usize; 2] {
        let photos = synthesizer.photos_mut();
        let views = 0..photos.views().scene().views.len();
        [photos.textures.iter().flatten().count(), views.filter(|&view| photos.depth_bytes(view) > 0).count()]
    }

    /// Renders from each of the scene's cameras and back again; the pictures, and the largest
    /// numbers of photos and depths in memory after a picture.
    fn along(kept_bytes: usize) -> (Vec<ImageRgb>, [usize; 2]) {
        let mut synthesizer = synthesizer(kept_bytes);
        let views = &synthesizer.scene().views;
        let cameras: Vec<_> = views.iter().chain(views.iter().rev()).map(|view| view.camera.clone()).collect();
        let shots = synthesizer.shots(Targets::cameras(cameras)).unwrap();
        let (mut pictures, mut most) = (Vec::new(), [0, 0]);
        for (index, shot) in shots.iter().enumerate() {
            let loaded = synthesizer.load(shot, &shots[index + 1..]).unwrap();
            let [photos, _] = held(&mut synthesizer);
            let plan = synthesizer.plan(&loaded).unwrap();
            pictures.push(synthesizer.render_plan(&loaded, &plan, None).unwrap().raw().clone());
            most = [most[0].max(photos), most[1].max(held(&mut synthesizer)[1])];
        }
        (pictures, most)
    }

    #[test]
    fn pictures_with_and_without_retention_are_equal() {
        let (all, most) = along(usize::MAX);
        let (none, fewest) = along(0);
        assert_eq!(all.len(), 18);
        assert!(all == none);
        // One view and two helpers each of this target and of the next.
        assert_eq!(most, [9, 9], "all of the scene");
        assert!(fewest.iter().all(|&held| (3..=6).contains(&held)), "{fewest:?}");
    }

    #[test]
    fn unneeded_depth_within_the_limit_stays_in_memory() {
        for (kept_bytes, expected) in [(usize::MAX, [3, 9]), (0, [3, 3])] {
            let mut synthesizer = synthesizer(kept_bytes);
            let views = synthesizer.scene().views.clone();
            for view in &views {
                synthesizer.render(&Target::Camera(view.camera.clone())).unwrap();
            }
            let shot = synthesizer.shots(Targets::cameras(vec![views[0].camera.clone()])).unwrap().remove(0);
            let loaded = synthesizer.load(&shot, &[]).unwrap();
            synthesizer.plan(&loaded).unwrap();
            synthesizer.load(&shot, &[]).unwrap();
            assert_eq!(held(&mut synthesizer), expected);
        }
    }

    #[test]
    fn depths_that_no_later_view_needs_stay_within_the_limit() {
        for (kept_bytes, expected) in [(usize::MAX, [0, 9]), (0, [0, 0])] {
            let mut synthesizer = synthesizer(kept_bytes);
            let mut most = 0;
            for view in 0..9 {
                let later: Vec<usize> = (view + 1..9).collect();
                synthesizer.photos_mut().view_depth(view, &[], &later, false).unwrap();
                most = most.max(held(&mut synthesizer)[1]);
            }
            assert_eq!(held(&mut synthesizer), expected);
            assert!(most >= 6, "{most}");
        }
    }

    #[test]
    fn photos_needed_sooner_stay_in_memory() {
        let mut synthesizer = synthesizer(0);
        let one = synthesizer.scene().views.iter().map(|view| view.camera.clone()).collect();
        let shots = synthesizer.shots(Targets::cameras(one)).unwrap();
        let photos = synthesizer.photos_mut();
        let all: Vec<usize> = shots.iter().flat_map(Shot::photos).collect();
        photos.load_views(&all).unwrap();
        photos.kept_bytes = 2 * photos.photo_bytes(0);
        photos.load(&shots[0], &shots[1..]).unwrap();
        let (mut order, mut listed) = (Vec::new(), HashSet::new());
        order.extend(shots[..2].iter().flat_map(Shot::photos).filter(|&view| listed.insert(view)));
        let soon = order.len();
        order.extend(shots[2..].iter().flat_map(Shot::photos).filter(|&view| listed.insert(view)));
        let mut expected = order[..soon + 2].to_vec();
        expected.sort_unstable();
        let loaded: Vec<usize> = (0..photos.textures.len()).filter(|&view| photos.textures[view].is_some()).collect();
        assert_eq!(loaded, expected);
    }
}
