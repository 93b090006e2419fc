//! The depth of a scene's photos: searched when it is first needed, or taken from a folder where an earlier run has kept it.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::error::SynthesisError;
use super::photo_cache::PhotoCache;
use super::scene_depth::SceneDepth;
use super::target::Shot;
use crate::surface::cache::{DepthCache, PhotoDigest};
use crate::surface::{ConfirmedDepth, PhotoCorrection, PhotoDepth, TargetSurface};

/// A folder of depths, and what has been found out on the way.
pub(super) struct KeptDepths {
    folder: DepthCache,
    /// Of each view's photo, once it has been loaded.
    digests: Vec<Option<PhotoDigest>>,
    notes: Vec<String>,
}

/// How the depth of a photo was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DepthSource {
    /// Searched among the photo's neighbours.
    Searched,
    /// Read from the folder of [`PhotoCache::keep_depths_in`].
    Kept,
    /// There is no other photo to search it with: nothing is confirmed.
    Alone,
}

/// The depth of a view's photo.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ViewDepth {
    /// What the search found.
    pub found: Arc<PhotoDepth>,
    /// Of that, what the depths of the photo's neighbours confirm.
    pub known: ConfirmedDepth,
    /// Nearest and farthest depth searched, scene units.
    pub range: (f64, f64),
    /// How it was found.
    pub source: DepthSource,
    /// Wall time of that, without loading photos and taking their digests.
    pub time: Duration,
}

impl PhotoCache {
    /// Keeps the depth of photos in a folder, one file each, and takes from there what an earlier run has kept; pictures stay the same,
    /// bit for bit. The folder is made if there is none.
    ///
    /// A file `<digest>.npz` holds the arrays `disparity` (float32 `[h, w]`, 1/scene unit), `pixel` (float32, the disparity that is worth a
    /// pixel of parallax) and `key` (uint8 `[32]`): the SHA-256 of the photo's and its neighbours' pixels and cameras, the depth range and the
    /// settings. Any file may be deleted; one that is damaged is told of in [`Self::take_notes`] and written anew.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Cache`] if files cannot be written there.
    pub fn keep_depths_in(&mut self, folder: &Path) -> Result<(), SynthesisError> {
        let refused = |source| SynthesisError::Cache { folder: folder.to_owned(), source };
        let folder = DepthCache::open(folder).map_err(refused)?;
        let digests = vec![None; self.scene().views.len()];
        self.kept = Some(KeptDepths { folder, digests, notes: Vec::new() });
        Ok(())
    }

    /// What went wrong with files of the folder of depths since the last call, a line each; nothing else depends on it.
    pub fn take_notes(&mut self) -> Vec<String> {
        self.kept.as_mut().map(|kept| std::mem::take(&mut kept.notes)).unwrap_or_default()
    }

    /// The target's surface by the photos' own depth, and what its views see of it. The depth of a photo is searched when it is first
    /// needed, over the depth range of all views that are not held out, and kept.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read; those of [`Self::depth_range`].
    ///
    /// # Panics
    ///
    /// If the shot's photos are not loaded ([`Self::load_for`]).
    pub fn surface(&mut self, shot: &Shot, photo_correction: PhotoCorrection) -> Result<TargetSurface, SynthesisError> {
        let mut depth = self.take_depth(&shot.held_out)?;
        let set: Vec<usize> = shot.views.iter().chain(&shot.helpers).copied().collect();
        set.iter().try_for_each(|&view| self.find_depth(&mut depth, view))?;
        let found = depth.surface(shot, &set, |view| self.source(view), photo_correction);
        self.depth = Some(depth);
        Ok(found)
    }

    /// The depth of a view's photo, and what its neighbours confirm of it. What is known already is not searched again, as long as
    /// the same views are held out; photos and depths that none of the `later` views needs are dropped.
    ///
    /// # Errors
    ///
    /// Those of [`Self::surface`].
    ///
    /// # Panics
    ///
    /// If there is no such view, or it is held out.
    pub fn view_depth(
        &mut self,
        view: usize,
        held_out: &[usize],
        later: &[usize],
    ) -> Result<ViewDepth, SynthesisError> {
        let mut depth = self.take_depth(held_out)?;
        for view in depth.with_neighbours(view) {
            self.find_depth(&mut depth, view)?;
        }
        let found = depth.view_depth(view);
        let needed: Vec<usize> = later.iter().flat_map(|&view| depth.with_neighbours(view)).collect();
        depth.retain(&needed, &needed);
        let searched: Vec<usize> = needed.iter().flat_map(|&view| depth.photos_to_search(view)).collect();
        let unneeded = self.textures.iter_mut().enumerate().filter(|(view, _)| !searched.contains(view));
        unneeded.for_each(|(_, texture)| *texture = None);
        self.depth = Some(depth);
        Ok(found)
    }

    /// The depths with these views held out: those that there are, or none yet.
    fn take_depth(&mut self, held_out: &[usize]) -> Result<SceneDepth, SynthesisError> {
        if let Some(depth) = self.depth.take().filter(|depth| depth.serves(held_out)) {
            return Ok(depth);
        }
        let free: Vec<usize> = (0..self.scene().views.len()).filter(|view| !held_out.contains(view)).collect();
        let range = self.depth_range(&free)?;
        Ok(SceneDepth::new(self.scene(), free, held_out.to_vec(), range))
    }

    /// Finds the depth of a view's photo, unless it is known.
    fn find_depth(&mut self, depth: &mut SceneDepth, view: usize) -> Result<(), SynthesisError> {
        let photos = depth.photos_to_search(view);
        let key = match self.kept.take() {
            // Alone, there is nothing to keep.
            Some(mut kept) if photos.len() > 1 => {
                let digests = photos.iter().map(|&view| self.digest(&mut kept.digests[view], view));
                let digests = digests.collect::<Result<Vec<_>, _>>();
                self.kept = Some(kept);
                Some(depth.key(&photos, &digests?))
            }
            kept => {
                self.kept = kept;
                None
            }
        };
        let started = Instant::now();
        if let (Some(kept), Some(key)) = (&mut self.kept, &key) {
            match kept.folder.load(key) {
                Ok(Some(found)) => {
                    depth.insert(view, found, DepthSource::Kept, started.elapsed());
                    return Ok(());
                }
                Ok(None) => {}
                Err(damage) => kept.notes.push(format!("{damage}: the depth is searched anew")),
            }
        }
        photos.iter().try_for_each(|&view| self.load(view))?;
        depth.search(view, |view| self.source(view));
        if let (Some(kept), Some(key)) = (&mut self.kept, &key) {
            let stored = depth.found(view).map_or(Ok(()), |found| kept.folder.store(key, found));
            stored.unwrap_or_else(|error| kept.notes.push(format!("{error}: the depth is not kept")));
        }
        Ok(())
    }

    /// The digest of a view's photo, which is loaded for it if it is not known.
    fn digest(&mut self, known: &mut Option<PhotoDigest>, view: usize) -> Result<PhotoDigest, SynthesisError> {
        if let Some(digest) = known {
            return Ok(*digest);
        }
        self.load(view)?;
        Ok(*known.insert(PhotoDigest::new(self.source(view).texture)))
    }
}
