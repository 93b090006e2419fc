//! The depth of a scene's photos: searched when it is first needed, or read from a folder where an
//! earlier run has stored it.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use super::depth_search::{DepthSearch, FoundDepth, SearchedPhoto};
use super::depth_store::{DepthFiles, with_held_out};
use super::scene_depth::{DepthProgress, ViewDepth};
use crate::error::SynthesisError;
use crate::find_layers::PhotosWithDepth;
use crate::scene_photos::ScenePhotos;
#[cfg(doc)]
use crate::scene_views::SceneViews;
use crate::shot::{LoadedShot, Shot};
use liveview_surface::cache::DepthCache;

impl ScenePhotos {
    /// Keeps the depth of photos in a folder, one file each, and reads from there what an earlier
    /// run has kept; pictures stay the same, bit for bit. The folder is created if there is none.
    ///
    /// A file `<digest>.npz` holds the arrays `disparity` (float32 `[h, w]`, 1/scene unit), `pixel`
    /// (float32, the disparity that is worth a pixel of parallax) and `key` (uint8 `[32]`): the
    /// SHA-256 of the photo's and its neighbours' pixels and cameras, the depth range and the
    /// settings. Any file may be deleted; a damaged one is reported by [`Self::take_notes`] and
    /// written again.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Cache`] if files cannot be written there.
    pub fn keep_depths_in(&mut self, folder: &Path) -> Result<(), SynthesisError> {
        let refused = |source| SynthesisError::Cache { folder: folder.to_owned(), source };
        let folder = DepthCache::open(folder).map_err(refused)?;
        let digests = vec![None; self.views.scene().views.len()];
        self.depths.files = Some(DepthFiles { folder, digests, notes: Vec::new() });
        Ok(())
    }

    /// Calls `progress` before each search for the depth of a photo, which takes a second or so of a
    /// large one. Where it returns [`ControlFlow::Break`], there are no more searches, and what
    /// needed the depth returns [`SynthesisError::Cancelled`]; depths found so far are kept.
    pub fn on_depth_search(&mut self, progress: impl FnMut(DepthProgress<'_>) -> ControlFlow<()> + Send + 'static) {
        self.depths.progress = Some(Box::new(progress));
    }

    /// What went wrong with files of the folder of depths since the last call, a line each; nothing
    /// else depends on it.
    pub fn take_notes(&mut self) -> Vec<String> {
        self.depths.files.as_mut().map(|files| std::mem::take(&mut files.notes)).unwrap_or_default()
    }

    /// The views of a shot whose photos' depth is not known: rendering it along the surface searches
    /// them.
    pub fn unknown_depths(&self, shot: &Shot) -> Vec<usize> {
        let known = self.depths.depth.as_ref().filter(|depth| depth.held_out == shot.held_out);
        shot.photos().filter(|&view| known.is_none_or(|depth| depth.found(view).is_none())).collect()
    }

    /// The search for the depth of a view's photo, to be run on another thread while pictures are
    /// rendered, and given to [`Self::insert_depth`]; `None` if the depth is known. The result is
    /// the same as where it is searched when it is needed. With the views of the shot held out; what is
    /// found is compared with the depths that are known of the shot's photos, so that its plan takes less
    /// time.
    ///
    /// # Errors
    ///
    /// Those of [`SceneViews::depth_range`].
    ///
    /// # Panics
    ///
    /// If there is no such view, or it is held out.
    pub fn depth_search(&mut self, view: usize, shot: &Shot) -> Result<Option<DepthSearch>, SynthesisError> {
        self.search(view, &shot.held_out, &shot.photos().collect::<Vec<_>>())
    }

    /// As [`Self::depth_search`], compared with the depths that are known of other views' photos.
    fn search(
        &mut self,
        view: usize,
        held_out: &[usize],
        compared: &[usize],
    ) -> Result<Option<DepthSearch>, SynthesisError> {
        let depth = with_held_out(&mut self.depths.depth, &self.views, held_out)?;
        if depth.found(view).is_some() {
            return Ok(None);
        }
        let group = depth.with_neighbours(view);
        let searched: Vec<Vec<usize>> = group.iter().map(|&view| depth.with_neighbours(view)).collect();
        let all = searched.iter().flatten().copied();
        let further: BTreeSet<usize> = all.filter(|view| !group.contains(view)).collect();
        let compared: Vec<usize> = compared.iter().filter_map(|&view| depth.find_map_index(view)).collect();
        let files = self.depths.files.as_ref();
        let photo = |&view: &usize| SearchedPhoto {
            view,
            texture: self.photos.get(view),
            digest: files.and_then(|files| files.digests[view]),
        };
        Ok(Some(DepthSearch {
            scene: Arc::clone(&self.views.scene),
            held_out: held_out.to_vec(),
            photos: group.iter().map(photo).collect(),
            further: further.iter().map(photo).collect(),
            searched,
            range: depth.maps.range(),
            comparison: depth.maps.comparison(depth.map_index(view), &compared),
            small_maps: Arc::clone(&depth.small_maps),
            folder: files.map(|files| files.folder.clone()),
        }))
    }

    /// Takes what a search found, unless other views are held out now.
    pub fn insert_depth(&mut self, found: FoundDepth) {
        let held_out = &found.held_out;
        let Some(depth) = self.depths.depth.as_mut().filter(|depth| depth.held_out == *held_out) else { return };
        let index = depth.map_index(found.view());
        depth.maps.insert_compared(index, found.depth, found.votes);
        depth.sources[index] = (found.source, found.time);
        for photo in &found.photos {
            if let Some(texture) = &photo.texture {
                self.photos.insert(photo.view, texture);
            }
        }
        if let Some(files) = &mut self.depths.files {
            for photo in &found.photos {
                files.digests[photo.view] = files.digests[photo.view].or(photo.digest);
            }
            files.notes.extend(found.notes);
        }
    }

    /// The photos of a shot with their depth. The depth of a photo is searched when it is first
    /// needed, over the depth range of all views that are not held out, and kept.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read; those of
    /// [`SceneViews::depth_range`].
    pub(crate) fn with_depth<'a>(
        &'a mut self,
        LoadedShot { shot, photos }: &'a LoadedShot,
    ) -> Result<PhotosWithDepth<'a>, SynthesisError> {
        self.find_all(&shot.held_out, &shot.photos().collect::<Vec<_>>())?;
        let depth = with_held_out(&mut self.depths.depth, &self.views, &shot.held_out)?;
        let photos = photos.iter().map(|photo| (depth.map_index(photo.view), photo.source())).collect();
        Ok(PhotosWithDepth { photos, maps: &mut depth.maps, rendered_from: shot.views.len(), searched: 1.0 })
    }

    /// The depth of a view's photo, and what its neighbours confirm of it. A depth that is known is
    /// not searched again as long as the same views are held out. Photos that none of the `later`
    /// views needs are dropped, and so are depths, of which [`Self::KEPT_BYTES`] stay.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read; those of
    /// [`SceneViews::depth_range`]; [`SynthesisError::Cancelled`].
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
        let depth = with_held_out(&mut self.depths.depth, &self.views, held_out)?;
        let wanted = depth.with_neighbours(view);
        self.find_all(held_out, &wanted)?;
        let depth = with_held_out(&mut self.depths.depth, &self.views, held_out)?;
        let index = depth.map_index(view);
        let (source, time) = depth.sources[index];
        let (found, confirmed) = depth.maps.confirmed_by_neighbours(index).expect("found just now");
        let found = ViewDepth { found, confirmed, range: depth.maps.range(), source, time };
        let needed: Vec<usize> = later.iter().flat_map(|&view| depth.with_neighbours(view)).collect();
        let mut spare = self.retention.bytes;
        let mut fits = |bytes: usize| spare.checked_sub(bytes).inspect(|&rest| spare = rest).is_some();
        let others = (0..self.views.scene().views.len()).filter(|view| !needed.contains(view));
        let kept = others.filter(|&view| fits(depth.bytes(view))).chain(needed.iter().copied()).collect::<Vec<_>>();
        depth.retain(&kept, &needed);
        let unknown = needed.iter().filter(|&&view| depth.found(view).is_none());
        let searched: Vec<usize> = unknown.flat_map(|&view| depth.with_neighbours(view)).collect();
        self.photos.retain(|view| searched.contains(&view));
        Ok(found)
    }

    /// Finds the depth of these views' photos where it is unknown.
    fn find_all(&mut self, held_out: &[usize], wanted: &[usize]) -> Result<(), SynthesisError> {
        let depth = with_held_out(&mut self.depths.depth, &self.views, held_out)?;
        let unknown: Vec<usize> = wanted.iter().copied().filter(|&view| depth.found(view).is_none()).collect();
        for (done, &view) in unknown.iter().enumerate() {
            let next = DepthProgress { name: &self.views.scene().views[view].name, done, count: unknown.len() };
            if self.depths.progress.as_mut().is_some_and(|progress| progress(next).is_break()) {
                return Err(SynthesisError::Cancelled);
            }
            if let Some(search) = self.search(view, held_out, &[])? {
                self.insert_depth(search.run()?);
            }
        }
        Ok(())
    }
}
