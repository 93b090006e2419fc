//! The depth of a scene's photos: searched when it is first needed, or read from a folder where an
//! earlier run has stored it.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;

use super::depth_search::{DepthSearch, FoundDepth, SearchedPhoto};
use super::scene_depth::{DepthProgress, SceneDepth, ViewDepth};
use crate::kinds::PhotosWithDepth;
use crate::surface::cache::{DepthCache, PhotoDigest};
use crate::synthesizer::error::SynthesisError;
use crate::synthesizer::photo_store::PhotoStore;
use crate::synthesizer::scene_views::SceneViews;
use crate::synthesizer::shot::{LoadedShot, Shot};

/// The depth of photos in memory, and the folder that keeps it from run to run, if there is one.
#[derive(Default)]
pub(in crate::synthesizer) struct DepthStore {
    /// For the views held out by the last shot.
    depth: Option<SceneDepth>,
    files: Option<DepthFiles>,
    progress: Option<OnSearch>,
}

/// Called before each search; returning `Break` ends it.
pub(in crate::synthesizer) type OnSearch = Box<dyn FnMut(DepthProgress<'_>) -> ControlFlow<()> + Send>;

/// A folder of depths, with the digests of photos and what went wrong with its files.
struct DepthFiles {
    folder: DepthCache,
    /// Of each view's photo, once it has been loaded.
    digests: Vec<Option<PhotoDigest>>,
    notes: Vec<String>,
}

impl DepthStore {
    /// Stores depths in a folder, for a scene of so many views.
    pub(in crate::synthesizer) fn keep_in(&mut self, folder: &Path, views: usize) -> Result<(), SynthesisError> {
        let refused = |source| SynthesisError::Cache { folder: folder.to_owned(), source };
        let folder = DepthCache::open(folder).map_err(refused)?;
        self.files = Some(DepthFiles { folder, digests: vec![None; views], notes: Vec::new() });
        Ok(())
    }

    /// Sets the callback that runs before each search.
    pub(in crate::synthesizer) fn set_progress(&mut self, progress: OnSearch) {
        self.progress = Some(progress);
    }

    /// What went wrong with files since the last call, a line each.
    pub(in crate::synthesizer) fn take_notes(&mut self) -> Vec<String> {
        self.files.as_mut().map(|files| std::mem::take(&mut files.notes)).unwrap_or_default()
    }

    /// The photos of a shot with their depth, which is found where it is unknown.
    pub(in crate::synthesizer) fn with_depth<'a>(
        &'a mut self,
        views: &SceneViews,
        photos: &mut PhotoStore,
        loaded: &'a LoadedShot,
    ) -> Result<PhotosWithDepth<'a>, SynthesisError> {
        let shot = loaded.shot();
        let depth = with_held_out(&mut self.depth, views, &shot.held_out)?;
        let set = loaded.photos();
        let needed: Vec<usize> = set.iter().map(|photo| photo.view).collect();
        find_all(depth, &mut self.files, &mut self.progress, views, photos, &needed)?;
        let set: Vec<_> = set.iter().map(|photo| (photo.view, photo.source())).collect();
        Ok(depth.with_depth(&set, shot.views.len()))
    }

    /// The depth of a view's photo, and what its neighbours confirm of it. Photos that none of the
    /// `later` views needs are dropped, and so are depths beyond `spare` bytes of them.
    pub(in crate::synthesizer) fn view_depth(
        &mut self,
        views: &SceneViews,
        photos: &mut PhotoStore,
        view: usize,
        held_out: &[usize],
        (later, mut spare): (&[usize], usize),
    ) -> Result<ViewDepth, SynthesisError> {
        let depth = with_held_out(&mut self.depth, views, held_out)?;
        let wanted = depth.with_neighbours(view);
        find_all(depth, &mut self.files, &mut self.progress, views, photos, &wanted)?;
        let found = depth.view_depth(view).expect("found just now");
        let needed: Vec<usize> = later.iter().flat_map(|&view| depth.with_neighbours(view)).collect();
        let mut fits = |bytes: usize| spare.checked_sub(bytes).inspect(|&rest| spare = rest).is_some();
        let others = (0..views.scene().views.len()).filter(|view| !needed.contains(view));
        let kept = others.filter(|&view| fits(depth.bytes(view))).chain(needed.iter().copied()).collect::<Vec<_>>();
        depth.retain(&kept, &needed);
        let searched: Vec<usize> = needed.iter().flat_map(|&view| depth.photos_to_search(view)).collect();
        photos.retain(|view| searched.contains(&view));
        Ok(found)
    }

    /// The views whose depth is not known with these views held out.
    pub(in crate::synthesizer) fn unknown(&self, views: &[usize], held_out: &[usize]) -> Vec<usize> {
        let known = self.depth.as_ref().filter(|depth| depth.serves(held_out));
        views.iter().copied().filter(|&view| known.is_none_or(|depth| depth.found(view).is_none())).collect()
    }

    /// The search for the depth of a view's photo, compared with those known of a shot's photos; `None` if
    /// it is known.
    pub(in crate::synthesizer) fn search(
        &mut self,
        views: &SceneViews,
        photos: &PhotoStore,
        view: usize,
        shot: &Shot,
    ) -> Result<Option<DepthSearch>, SynthesisError> {
        let depth = with_held_out(&mut self.depth, views, &shot.held_out)?;
        Ok(search(depth, &self.files, views, photos, view, &shot.photos().collect::<Vec<_>>()))
    }

    /// Takes a depth and the photos that were read for it, unless other views are held out now.
    pub(in crate::synthesizer) fn insert(&mut self, photos: &mut PhotoStore, found: FoundDepth) {
        if let Some(depth) = self.depth.as_mut().filter(|depth| depth.serves(&found.held_out)) {
            insert(depth, &mut self.files, photos, found);
        }
    }

    /// Drops the depth of all views but these, and what confirms it unless it is needed `soon`.
    pub(in crate::synthesizer) fn retain(&mut self, views: &[usize], soon: &[usize]) {
        if let Some(depth) = &mut self.depth {
            depth.retain(views, soon);
        }
    }

    /// Bytes of the depth of a view's photo; 0 if it is not in memory.
    pub(in crate::synthesizer) fn bytes(&self, view: usize) -> usize {
        self.depth.as_ref().map_or(0, |depth| depth.bytes(view))
    }
}

/// The depths with these views held out: those in memory, or none yet.
fn with_held_out<'a>(
    depth: &'a mut Option<SceneDepth>,
    views: &SceneViews,
    held_out: &[usize],
) -> Result<&'a mut SceneDepth, SynthesisError> {
    *depth = match depth.take().filter(|depth| depth.serves(held_out)) {
        None => {
            let free = views.all_but(held_out);
            let range = views.depth_range(&free, held_out)?;
            Some(SceneDepth::new(views.scene(), free, held_out.to_vec(), range))
        }
        known => known,
    };
    Ok(depth.as_mut().expect("set just now"))
}

/// Finds the depth of these views' photos where it is unknown.
fn find_all(
    depth: &mut SceneDepth,
    files: &mut Option<DepthFiles>,
    progress: &mut Option<OnSearch>,
    views: &SceneViews,
    photos: &mut PhotoStore,
    wanted: &[usize],
) -> Result<(), SynthesisError> {
    let unknown: Vec<usize> = wanted.iter().copied().filter(|&view| depth.found(view).is_none()).collect();
    for (done, &view) in unknown.iter().enumerate() {
        let next = DepthProgress { name: &views.scene().views[view].name, done, count: unknown.len() };
        if progress.as_mut().is_some_and(|progress| progress(next).is_break()) {
            return Err(SynthesisError::Cancelled);
        }
        if let Some(search) = search(depth, files, views, photos, view, &[]) {
            insert(depth, files, photos, search.run()?);
        }
    }
    Ok(())
}

/// The search for the depth of a view's photo, compared with those known of other views' photos; `None` if
/// it is known.
fn search(
    depth: &SceneDepth,
    files: &Option<DepthFiles>,
    views: &SceneViews,
    photos: &PhotoStore,
    view: usize,
    compared: &[usize],
) -> Option<DepthSearch> {
    let group = depth.photos_to_search(view);
    let searched: Vec<Vec<usize>> = group.iter().map(|&view| depth.with_neighbours(view)).collect();
    let further: BTreeSet<usize> = searched.iter().flatten().copied().filter(|view| !group.contains(view)).collect();
    let photo = |&view: &usize| SearchedPhoto {
        view,
        texture: photos.get(view),
        digest: files.as_ref().and_then(|files| files.digests[view]),
    };
    (!group.is_empty()).then(|| DepthSearch {
        scene: views.shared_scene(),
        held_out: depth.held_out().to_vec(),
        photos: group.iter().map(photo).collect(),
        further: further.iter().map(photo).collect(),
        searched,
        range: depth.range(),
        comparison: depth.comparison(view, compared),
        small_maps: depth.small_maps(),
        folder: files.as_ref().map(|files| files.folder.clone()),
    })
}

/// Takes a depth and the photos that were read for it.
fn insert(depth: &mut SceneDepth, files: &mut Option<DepthFiles>, photos: &mut PhotoStore, found: FoundDepth) {
    let view = found.view();
    depth.insert(view, (found.depth, found.votes), found.source, found.time);
    for photo in &found.photos {
        if let Some(texture) = &photo.texture {
            photos.insert(photo.view, texture);
        }
    }
    if let Some(files) = files {
        found.photos.iter().for_each(|photo| files.digests[photo.view] = files.digests[photo.view].or(photo.digest));
        files.notes.extend(found.notes);
    }
}
