//! Which photos, and which depths of photos, stay in memory from one target to the next.
//!
//! What the target and the one after it need stays. Of the rest, as much as fits into a fixed
//! number of bytes: first depths, which take longest to find and least to keep, then photos; of
//! each, those needed sooner before those needed later, and depths that no known target needs after
//! these, last used first. What is dropped is found again when it is needed, the same bit for bit.

use std::collections::HashSet;

use super::depth::depth_store::DepthStore;
use super::photo_store::PhotoStore;
use super::shot::Shot;

/// Bytes of photos and depths that stay beyond what the target and the next one need.
pub(super) const KEPT_BYTES: usize = 128 << 20;

/// What has been used lately, and how many bytes of it stay.
pub(super) struct Retention {
    /// Views that targets so far were rendered with, last used first.
    recent: Vec<usize>,
    /// Bytes kept beyond what the target and the next one need.
    pub(super) bytes: usize,
}

impl Retention {
    pub(super) fn new() -> Self {
        Self { recent: Vec::new(), bytes: KEPT_BYTES }
    }

    /// Drops what the shot does not need, and of what `later` shots need that which exceeds the
    /// limit.
    pub(super) fn drop_unneeded(
        &mut self,
        shot: &Shot,
        later: &[Shot],
        photos: &mut PhotoStore,
        depths: &mut DepthStore,
    ) {
        // Views in the order in which they are needed, each once.
        let (mut order, mut listed) = (Vec::new(), HashSet::new());
        let next = later.iter().take(1).flat_map(Shot::photos);
        order.extend(shot.photos().chain(next).filter(|&view| listed.insert(view)));
        let soon = order.len();
        order.extend(later.iter().skip(1).flat_map(Shot::photos).filter(|&view| listed.insert(view)));
        let ever = order.len();
        // Then those that no known target needs: later targets may not be known yet.
        order.extend(self.recent.iter().copied().filter(|&view| listed.insert(view)));

        let mut left = self.bytes;
        let mut fits = |bytes: usize| left.checked_sub(bytes).inspect(|&rest| left = rest).is_some();
        {
            let kept = order.iter().enumerate().filter(|&(rank, &view)| rank < soon || fits(depths.bytes(view)));
            let kept: Vec<usize> = kept.map(|(_, &view)| view).collect();
            depths.retain(&kept, &order[..soon]);
        }
        let kept = order[..ever].iter().enumerate().filter(|&(rank, &view)| rank < soon || fits(photos.bytes(view)));
        let kept: HashSet<usize> = kept.map(|(_, &view)| view).collect();
        photos.retain(|view| kept.contains(&view));

        self.recent.retain(|&view| !shot.photos().any(|needed| needed == view));
        self.recent.splice(..0, shot.photos());
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::ViewAgreement;
    use crate::{SceneViews, Synthesizer, Target, Targets};
    use liveview::ImageRgb;
    use liveview::render::Renderer;
    use liveview_scene::{Scene, SceneOptions};

    fn synthesizer(kept_bytes: usize) -> Synthesizer {
        let options = SceneOptions { width: Some(96), ..SceneOptions::default() };
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/scenes/workshop");
        let views = SceneViews::new(Scene::open(&folder, &options).unwrap(), None, None);
        let renderer = Renderer::new(Box::new(ViewAgreement { views: 1 }), ViewAgreement::ALPHA, 1);
        let mut synthesizer = Synthesizer::new(views, renderer, "surface:1".parse().unwrap());
        synthesizer.photos_mut().retention.bytes = kept_bytes;
        synthesizer
    }

    /// Photos in memory, and photos whose depth is.
    fn held(synthesizer: &mut Synthesizer) -> [usize; 2] {
        let photos = synthesizer.photos_mut();
        let views = 0..photos.views().scene().views.len();
        [photos.photos.loaded().count(), views.filter(|&view| photos.depths.bytes(view) > 0).count()]
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
                synthesizer.render(&Target::camera(view.camera.clone())).unwrap();
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
                synthesizer.photos_mut().view_depth(view, &[], &later).unwrap();
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
        photos.photos.load(photos.views.scene(), &all).unwrap();
        photos.retention.bytes = 2 * photos.photos.bytes(0);
        photos.load(&shots[0], &shots[1..]).unwrap();
        let (mut order, mut listed) = (Vec::new(), HashSet::new());
        order.extend(shots[..2].iter().flat_map(Shot::photos).filter(|&view| listed.insert(view)));
        let soon = order.len();
        order.extend(shots[2..].iter().flat_map(Shot::photos).filter(|&view| listed.insert(view)));
        let mut expected = order[..soon + 2].to_vec();
        expected.sort_unstable();
        assert_eq!(photos.photos.loaded().collect::<Vec<_>>(), expected);
    }
}
