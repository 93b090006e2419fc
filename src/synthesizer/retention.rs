//! Which photos, and which depths of photos, stay in memory from one target to the next.
//!
//! What the target and the one after it need stays. Of the rest, as much as fits into a fixed number of bytes: first depths, which take
//! longest to find and least to keep, then photos; of each, those needed sooner before those needed later, and depths that no known
//! target needs after these, last used first. What is dropped is found again when it is needed, the same bit for bit.

use super::error::SynthesisError;
use super::photo_cache::PhotoCache;
use super::target::Shot;

impl PhotoCache {
    /// Bytes of photos and depths that [`Self::load_for`] keeps beyond what the target and the next one need.
    pub const KEPT_BYTES: usize = 128 << 20;

    /// Loads the photos of a shot. `later` are the shots that follow, in order: of photos and depths in memory, those that the first of
    /// them needs stay, others as far as 128 MiB go, those needed sooner first; photos that no later shot needs are dropped.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read.
    pub fn load_for(&mut self, shot: &Shot, later: &[Shot]) -> Result<(), SynthesisError> {
        self.drop_unneeded(shot, later);
        needed(shot).try_for_each(|view| self.load(view))
    }

    fn drop_unneeded(&mut self, shot: &Shot, later: &[Shot]) {
        // Views in the order in which they are needed, each once.
        let mut order = Order::new(self.textures.len());
        needed(shot).for_each(|view| order.push(view));
        later.iter().take(1).flat_map(needed).for_each(|view| order.push(view));
        let soon = order.views.len();
        later.iter().skip(1).flat_map(needed).for_each(|view| order.push(view));
        let ever = order.views.len();
        // Then those that no known target needs: who renders target by target knows of none.
        self.recent.iter().for_each(|&view| order.push(view));
        let order = order.views;

        let mut left = self.kept_bytes;
        let mut fits = |bytes: usize| left.checked_sub(bytes).inspect(|&rest| left = rest).is_some();
        #[cfg(feature = "surface")]
        if let Some(depth) = &mut self.depth {
            let kept = order.iter().enumerate().filter(|&(rank, &view)| rank < soon || fits(depth.bytes(view)));
            let kept: Vec<usize> = kept.map(|(_, &view)| view).collect();
            depth.retain(&kept, &order[..soon]);
        }
        let mut keep = vec![false; self.textures.len()];
        for (rank, &view) in order[..ever].iter().enumerate() {
            keep[view] = rank < soon || self.textures[view].as_ref().is_some_and(|photo| fits(photo.bytes()));
        }
        self.textures.iter_mut().zip(keep).filter(|(_, keep)| !keep).for_each(|(photo, _)| *photo = None);

        self.recent.retain(|&view| !needed(shot).any(|needed| needed == view));
        self.recent.splice(..0, needed(shot));
    }
}

/// The views that a shot needs.
fn needed(shot: &Shot) -> impl Iterator<Item = usize> {
    shot.views.iter().chain(&shot.helpers).copied()
}

/// Views, each once.
struct Order {
    views: Vec<usize>,
    listed: Vec<bool>,
}

impl Order {
    fn new(views: usize) -> Self {
        Self { views: Vec::new(), listed: vec![false; views] }
    }

    fn push(&mut self, view: usize) {
        if !std::mem::replace(&mut self.listed[view], true) {
            self.views.push(view);
        }
    }
}

#[cfg(all(test, feature = "surface"))]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::image::ImageRgb;
    use crate::network::ViewAgreement;
    use crate::render::Renderer;
    use crate::scene::{Scene, SceneOptions};
    use crate::synthesizer::{Synthesizer, Target, Targets};

    fn synthesizer(kept_bytes: usize) -> Synthesizer {
        let options = SceneOptions { width: Some(96), ..SceneOptions::default() };
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenes/workshop");
        let mut photos = PhotoCache::new(Scene::open(&folder, &options).unwrap(), None, None);
        photos.kept_bytes = kept_bytes;
        Synthesizer::new(photos, Renderer::new(Box::new(ViewAgreement { views: 1 }), 1), "surface:1".parse().unwrap())
    }

    /// Photos in memory, and photos whose depth is.
    fn held(synthesizer: &Synthesizer) -> [usize; 2] {
        let photos = synthesizer.photos();
        let depth = |view: &usize| photos.depth.as_ref().is_some_and(|depth| depth.bytes(*view) > 0);
        let views = || 0..photos.textures.len();
        [views().filter(|&view| photos.textures[view].is_some()).count(), views().filter(depth).count()]
    }

    /// Cameras along the scene's own and back; the pictures, and the most that was held when one was done.
    fn along(kept_bytes: usize) -> (Vec<ImageRgb>, [usize; 2]) {
        let mut synthesizer = synthesizer(kept_bytes);
        let views = &synthesizer.photos().scene().views;
        let cameras: Vec<_> = views.iter().chain(views.iter().rev()).map(|view| view.camera.clone()).collect();
        let shots = synthesizer.shots(Targets::cameras(cameras)).unwrap();
        let (mut pictures, mut most) = (Vec::new(), [0, 0]);
        for (index, shot) in shots.iter().enumerate() {
            synthesizer.photos_mut().load_for(shot, &shots[index + 1..]).unwrap();
            let photos = synthesizer.photos().textures.iter().flatten().count();
            let plan = synthesizer.plan(shot).unwrap();
            pictures.push(synthesizer.render_plan(shot, &plan, |_| ()).unwrap().picture);
            most = [most[0].max(photos), most[1].max(held(&synthesizer)[1])];
        }
        (pictures, most)
    }

    #[test]
    fn pictures_are_the_same_whatever_is_dropped() {
        let (all, most) = along(usize::MAX);
        let (none, fewest) = along(0);
        assert_eq!(all.len(), 18);
        assert!(all == none);
        // One view and two helpers, of this target and of the next.
        assert_eq!(most, [9, 9], "all of the scene");
        assert!(fewest.iter().all(|&held| (3..=6).contains(&held)), "{fewest:?}");
    }

    #[test]
    fn depth_that_no_known_target_needs_stays_as_long_as_there_is_room() {
        for (kept_bytes, expected) in [(usize::MAX, [3, 9]), (0, [3, 3])] {
            let mut synthesizer = synthesizer(kept_bytes);
            let views = synthesizer.photos().scene().views.clone();
            for view in &views {
                synthesizer.render(&Target::camera(view.camera.clone())).unwrap();
            }
            let shot = synthesizer.shots(Targets::cameras(vec![views[0].camera.clone()])).unwrap().remove(0);
            synthesizer.photos_mut().load_for(&shot, &[]).unwrap();
            synthesizer.plan(&shot).unwrap();
            synthesizer.photos_mut().load_for(&shot, &[]).unwrap();
            assert_eq!(held(&synthesizer), expected);
        }
    }

    #[test]
    fn what_is_needed_sooner_stays() {
        let mut synthesizer = synthesizer(0);
        let one = synthesizer.photos().scene().views.iter().map(|view| view.camera.clone()).collect();
        let shots = synthesizer.shots(Targets::cameras(one)).unwrap();
        let photos = synthesizer.photos_mut();
        shots.iter().for_each(|shot| needed(shot).for_each(|view| photos.load(view).unwrap()));
        let bytes = photos.textures[0].as_ref().unwrap().bytes();
        photos.kept_bytes = 2 * bytes;
        photos.load_for(&shots[0], &shots[1..]).unwrap();
        let mut order = Order::new(photos.textures.len());
        shots[..2].iter().flat_map(needed).for_each(|view| order.push(view));
        let soon = order.views.len();
        shots.iter().flat_map(needed).for_each(|view| order.push(view));
        let mut expected = order.views[..soon + 2].to_vec();
        expected.sort_unstable();
        let held = (0..photos.textures.len()).filter(|&view| photos.textures[view].is_some());
        assert_eq!(held.collect::<Vec<_>>(), expected);
    }
}
