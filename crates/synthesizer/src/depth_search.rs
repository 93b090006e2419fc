//! The search for the depth of one photo, apart from the stores that its photos come from and its
//! result goes to: it may run on any thread.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::shot::LoadedPhoto;
use crate::{DepthSource, SynthesisError, memory};
use liveview::warp::{SourceView, Texture};
use liveview_scene::Scene;
use liveview_surface::cache::{DepthCache, DepthKey, PhotoDigest};
use liveview_surface::{Comparison, PhotoDisparity, SmallMaps, SmallPhoto, Votes, anchored_depth_in_scene};

/// A search for the depth of a view's photo, to be run on any thread
/// ([`crate::ScenePhotos::depth_search`]).
#[derive(Debug)]
pub struct DepthSearch {
    pub(crate) scene: Arc<Scene>,
    pub(crate) held_out: Vec<usize>,
    /// The view's photo, then those of its neighbours.
    pub(crate) photos: Vec<SearchedPhoto>,
    /// Those of their neighbours, which are needed at a small size.
    pub(crate) further: Vec<SearchedPhoto>,
    /// The view, then its neighbours, each with its own neighbours.
    pub(crate) searched: Vec<Vec<usize>>,
    /// Near and far, scene units.
    pub(crate) range: (f64, f64),
    /// What compares the depth with those of other photos that a target needs.
    pub(crate) comparison: Comparison,
    /// What earlier searches over this range found.
    pub(crate) small_maps: Arc<SmallMaps>,
    /// The folder that keeps depths.
    pub(crate) folder: Option<DepthCache>,
}

/// A photo that a search needs, as far as it is in memory.
#[derive(Debug)]
pub(crate) struct SearchedPhoto {
    pub(crate) view: usize,
    pub(crate) texture: Option<Arc<Texture>>,
    pub(crate) digest: Option<PhotoDigest>,
}

/// The depth of a view's photo, and the photos that were read for it
/// ([`crate::ScenePhotos::insert_depth`]).
#[derive(Debug)]
pub struct FoundDepth {
    pub(crate) held_out: Vec<usize>,
    pub(crate) photos: Vec<SearchedPhoto>,
    pub(crate) depth: PhotoDisparity,
    pub(crate) votes: Votes,
    pub(crate) source: DepthSource,
    pub(crate) time: Duration,
    /// What went wrong with files of the folder, a line each.
    pub(crate) notes: Vec<String>,
}

impl FoundDepth {
    /// The view whose photo was searched.
    pub fn view(&self) -> usize {
        self.photos[0].view
    }
}

impl DepthSearch {
    /// Searches the depth, or reads it from the folder that keeps depths.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read; [`SynthesisError::DepthMemory`].
    pub fn run(mut self) -> Result<FoundDepth, SynthesisError> {
        // The depth of a photo without neighbours is not worth a file.
        let folder = self.folder.take().filter(|_| self.photos.len() > 1);
        let key = if folder.is_some() { Some(self.key()?) } else { None };
        let mut notes = Vec::new();
        let started = Instant::now();
        if let (Some(folder), Some(key)) = (&folder, &key) {
            match folder.load(key) {
                Ok(Some(depth)) => return Ok(self.found(depth, DepthSource::Kept, started.elapsed(), notes)),
                Ok(None) => {}
                Err(damage) => notes.push(format!("{damage}: the depth is searched again")),
            }
        }
        memory::check_search(&self.scene, &self.searched[0], self.range)?;
        let photos = self.load()?;
        let sources: Vec<SourceView<'_>> = photos.iter().map(LoadedPhoto::source).collect();
        let started = Instant::now();
        let (depth, source) = match sources[..] {
            // Without neighbours there is nothing to find, and the depth is unknown everywhere.
            [photo] => (PhotoDisparity::unknown(photo.camera.size()), DepthSource::Alone),
            _ => {
                let small = |view, detail| -> Result<_, SynthesisError> {
                    Ok(SmallPhoto::new(&self.photo(view).read(&self.scene)?.source(), detail))
                };
                let (maps, searched) = (&self.small_maps, &self.searched);
                (anchored_depth_in_scene(&sources, self.range, maps, searched, small)?, DepthSource::Searched)
            }
        };
        let time = started.elapsed();
        if let (Some(folder), Some(key)) = (&folder, &key) {
            let stored = folder.store(key, &depth);
            stored.unwrap_or_else(|error| notes.push(format!("{error}: the depth is not kept")));
        }
        Ok(self.found(depth, source, time, notes))
    }

    fn found(self, depth: PhotoDisparity, source: DepthSource, time: Duration, notes: Vec<String>) -> FoundDepth {
        let votes = self.comparison.votes(&depth);
        let photos = self.photos.into_iter().chain(self.further).collect();
        FoundDepth { held_out: self.held_out, photos, depth, votes, source, time, notes }
    }

    /// What identifies the depth.
    fn key(&mut self) -> Result<DepthKey, SynthesisError> {
        let scene = &self.scene;
        let group = self.photos.par_iter_mut().map(|photo| photo.set_digest(scene, true));
        let further = self.further.par_iter_mut().map(|photo| photo.set_digest(scene, false));
        let digested: Vec<Result<(), SynthesisError>> = group.chain(further).collect();
        digested.into_iter().collect::<Result<(), _>>()?;
        let photo = |&view: &usize| (&self.scene.views[view].camera, self.photo(view).digest.expect("set above"));
        Ok(DepthKey::new(&self.searched.iter().flatten().map(photo).collect::<Vec<_>>(), self.range))
    }

    fn photo(&self, view: usize) -> &SearchedPhoto {
        let mut photos = self.photos.iter().chain(&self.further);
        photos.find(|photo| photo.view == view).expect("a photo of the search")
    }

    /// The view's photo and its neighbours', read from their files side by side. Of several
    /// errors it is the first photo's.
    fn load(&mut self) -> Result<Vec<LoadedPhoto>, SynthesisError> {
        let loaded: Vec<_> = self.photos.par_iter_mut().map(|photo| photo.load(&self.scene)).collect();
        loaded.into_iter().collect()
    }
}

impl SearchedPhoto {
    /// The photo, read from its file unless it is in memory.
    fn read(&self, scene: &Scene) -> Result<LoadedPhoto, SynthesisError> {
        Ok(LoadedPhoto::read(scene, self.view, self.texture.as_ref())?)
    }

    /// Sets the digest unless it is known; the photo is read for that, and stays in memory or not.
    fn set_digest(&mut self, scene: &Scene, stays: bool) -> Result<(), SynthesisError> {
        if self.digest.is_none() {
            let loaded = if stays { self.load(scene)? } else { self.read(scene)? };
            self.digest = Some(PhotoDigest::new(&loaded.texture));
        }
        Ok(())
    }

    /// As [`Self::read`]; it stays in memory.
    fn load(&mut self, scene: &Scene) -> Result<LoadedPhoto, SynthesisError> {
        let loaded = self.read(scene)?;
        self.texture = Some(Arc::clone(&loaded.texture));
        Ok(loaded)
    }
}
