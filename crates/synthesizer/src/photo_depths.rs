//! The depth of a scene's photos: searched when it is first needed, or read from a folder where an
//! earlier run has stored it.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::shot::LoadedPhoto;
use crate::{LoadedShot, PhotosWithDepth, ScenePhotos, SceneViews, SynthesisError, memory};
use liveview::Camera;
use liveview::warp::SourceView;
use liveview_surface::cache::{DepthCache, DepthKey, PhotoDigest};
use liveview_surface::{ConfirmedDisparity, DepthMaps, PhotoDisparity, SmallMaps, SmallPhoto, anchored_depth_in_scene};

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
        self.files = Some(DepthFiles { folder, digests, notes: Vec::new() });
        Ok(())
    }

    /// Calls `progress` before each search for the depth of a photo, which takes a second or so of a
    /// large one. Where it returns [`ControlFlow::Break`], there are no more searches, and what
    /// needed the depth returns [`SynthesisError::Cancelled`]; depths found so far are kept.
    pub fn on_depth_search(&mut self, progress: impl FnMut(DepthProgress<'_>) -> ControlFlow<()> + Send + 'static) {
        self.progress = Some(Box::new(progress));
    }

    /// What went wrong with files of the folder of depths since the last call, a line each; nothing
    /// else depends on it.
    pub fn take_notes(&mut self) -> Vec<String> {
        self.files.as_mut().map(|files| std::mem::take(&mut files.notes)).unwrap_or_default()
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
        let depth = with_held_out(&mut self.depth, &self.views, &shot.held_out)?;
        let photos = photos.iter().map(|photo| (photo.view, photo.source())).collect();
        Ok(PhotosWithDepth { photos, maps: &mut depth.maps, rendered_from: shot.views.len(), searched: 1.0 })
    }

    /// The depth of a view's photo, and what its neighbours confirm of it. A depth that is known is
    /// not searched again as long as the same views are held out. Photos that none of the `later`
    /// views needs are dropped, and so are depths, of which [`Self::KEPT_BYTES`] stay. With `nearer_edges`
    /// it is moved to the nearer side at edges where the neighbours show that: for a surface that is drawn.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read; those of
    /// [`SceneViews::depth_range`]; [`SynthesisError::Cancelled`]; [`SynthesisError::Memory`].
    ///
    /// # Panics
    ///
    /// If there is no such view, or it is held out.
    pub fn view_depth(
        &mut self,
        view: usize,
        held_out: &[usize],
        later: &[usize],
        nearer_edges: bool,
    ) -> Result<ViewDepth, SynthesisError> {
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        let wanted = depth.with_neighbours(view);
        self.find_all(held_out, &wanted)?;
        let photos = if nearer_edges { self.load_views(&wanted)? } else { Vec::new() };
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        let (source, time) = depth.sources[view];
        let (found, confirmed) = if nearer_edges {
            depth.maps.nearer_by_others(&photos.iter().map(|photo| (photo.view, photo.source())).collect::<Vec<_>>())
        } else {
            depth.maps.confirmed_by_neighbours(view).expect("found just now")
        };
        let found = ViewDepth { found, confirmed, range: depth.maps.range(), source, time };
        let needed: Vec<usize> = later.iter().flat_map(|&view| depth.with_neighbours(view)).collect();
        let mut spare = self.kept_bytes;
        let mut fits = |bytes: usize| spare.checked_sub(bytes).inspect(|&rest| spare = rest).is_some();
        let others = (0..self.views.scene().views.len()).filter(|view| !needed.contains(view));
        let kept = others.filter(|&view| fits(depth.bytes(view))).chain(needed.iter().copied()).collect::<Vec<_>>();
        depth.maps.retain(&kept, &needed);
        let unknown = needed.iter().filter(|&&view| depth.maps.get(view).is_none());
        let searched: Vec<usize> = unknown.flat_map(|&view| depth.with_neighbours(view)).collect();
        self.retain_photos(|view| searched.contains(&view));
        Ok(found)
    }

    /// Finds the depth of these views' photos where it is unknown.
    fn find_all(&mut self, held_out: &[usize], wanted: &[usize]) -> Result<(), SynthesisError> {
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        let unknown: Vec<usize> = wanted.iter().copied().filter(|&view| depth.maps.get(view).is_none()).collect();
        for (done, &view) in unknown.iter().enumerate() {
            let next = DepthProgress { name: &self.views.scene().views[view].name, done, count: unknown.len() };
            if self.progress.as_mut().is_some_and(|progress| progress(next).is_break()) {
                return Err(SynthesisError::Cancelled);
            }
            self.find(view, held_out)?;
        }
        Ok(())
    }

    /// Finds the depth of a view's photo: reads it from the folder that keeps depths, or searches it.
    fn find(&mut self, view: usize, held_out: &[usize]) -> Result<(), SynthesisError> {
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        let (group, range) = (depth.with_neighbours(view), depth.maps.range());
        // The view, then its neighbours, each with its own neighbours.
        let searched: Vec<Vec<usize>> = group.iter().map(|&view| depth.with_neighbours(view)).collect();
        // The depth of a photo without neighbours is not worth a file.
        let is_kept = self.files.is_some() && group.len() > 1;
        let key = if is_kept { Some(self.key(&searched, range)?) } else { None };
        let started = Instant::now();
        if let (Some(files), Some(key)) = (&mut self.files, &key) {
            match files.folder.load(key) {
                Ok(Some(found)) => {
                    let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
                    depth.insert(view, found, DepthSource::Kept, started);
                    return Ok(());
                }
                Ok(None) => {}
                Err(damage) => files.notes.push(format!("{damage}: the depth is searched again")),
            }
        }
        memory::check_search(self.views.scene(), &group, range)?;
        let photos = self.load_views(&group)?;
        let sources: Vec<SourceView<'_>> = photos.iter().map(LoadedPhoto::source).collect();
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        let started = Instant::now();
        let (found, source) = match sources[..] {
            // Without neighbours there is nothing to find, and the depth is unknown everywhere.
            [photo] => (PhotoDisparity::unknown(photo.camera.size()), DepthSource::Alone),
            _ => {
                let (scene, textures) = (&self.views.scene, &self.textures);
                let small = |view: usize, detail| -> Result<_, SynthesisError> {
                    let photo = LoadedPhoto::read(scene, view, textures[view].as_ref())?;
                    Ok(SmallPhoto::new(&photo.source(), detail))
                };
                let found = anchored_depth_in_scene(&sources, range, &depth.small_maps, &searched, small)?;
                (found, DepthSource::Searched)
            }
        };
        depth.insert(view, found, source, started);
        if let (Some(files), Some(key), Some(found)) = (&mut self.files, &key, depth.maps.get(view)) {
            let stored = files.folder.store(key, found);
            stored.unwrap_or_else(|error| files.notes.push(format!("{error}: the depth is not kept")));
        }
        Ok(())
    }

    /// What identifies the depth that is searched among these photos, given with their own neighbours.
    fn key(&mut self, searched: &[Vec<usize>], range: (f64, f64)) -> Result<DepthKey, SynthesisError> {
        let files = self.files.as_ref().expect("a folder that keeps depths");
        let all = searched.iter().flatten().copied();
        let unknown: BTreeSet<usize> = all.filter(|&view| files.digests[view].is_none()).collect();
        // Of these photos the search needs all pixels, of the others only small copies.
        let group: Vec<usize> = searched.iter().map(|photos| photos[0]).filter(|view| unknown.contains(view)).collect();
        self.load_views(&group)?;
        let digest = |view: usize| {
            let photo = LoadedPhoto::read(&self.views.scene, view, self.textures[view].as_ref());
            photo.map(|photo| (view, PhotoDigest::new(&photo.texture)))
        };
        let found: Vec<_> = unknown.into_par_iter().map(digest).collect();
        let digests = &mut self.files.as_mut().expect("as above").digests;
        for found in found {
            let (view, digest) = found?;
            digests[view] = Some(digest);
        }
        let photo = |&view: &usize| (&self.views.scene.views[view].camera, digests[view].expect("set above"));
        Ok(DepthKey::new(&searched.iter().flatten().map(photo).collect::<Vec<_>>(), range))
    }
}

/// How the depth of a photo was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DepthSource {
    /// Searched among the photo's neighbours.
    Searched,
    /// Read from the folder of [`crate::ScenePhotos::keep_depths_in`].
    Kept,
    /// There is no other photo to search it with: nothing is confirmed.
    Alone,
}

/// The depth of a view's photo.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ViewDepth {
    /// What the search found.
    pub found: Arc<PhotoDisparity>,
    /// Of that, what the depths of the photo's neighbours confirm.
    pub confirmed: ConfirmedDisparity,
    /// Nearest and farthest depth searched, scene units.
    pub range: (f64, f64),
    /// How it was found.
    pub source: DepthSource,
    /// Wall time of that, without loading photos and taking their digests.
    pub time: Duration,
}

/// The next photo whose depth is searched ([`crate::ScenePhotos::on_depth_search`]).
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct DepthProgress<'a> {
    /// The name of its view.
    pub name: &'a str,
    /// How many photos have been searched before it, of those that are needed now.
    pub done: usize,
    /// How many are needed now.
    pub count: usize,
}

/// The depth of a scene's photos, by view, of those that are not held out.
pub(crate) struct SceneDepth {
    pub(crate) maps: DepthMaps,
    /// What searches share.
    small_maps: SmallMaps,
    /// How each depth was found, and in what time.
    sources: Vec<(DepthSource, Duration)>,
}

impl SceneDepth {
    /// With these views held out; no depth is known yet.
    fn new(views: &SceneViews, held_out: &[usize]) -> Result<Self, SynthesisError> {
        let (near, far) = views.depth_range(&views.all_but(held_out), held_out)?;
        let cameras: Vec<Camera> = views.all_cameras().into_iter().cloned().collect();
        let sources = vec![(DepthSource::Alone, Duration::ZERO); cameras.len()];
        let mut maps = DepthMaps::new(cameras, near, far);
        maps.held_out = held_out.to_vec();
        Ok(Self { maps, small_maps: SmallMaps::default(), sources })
    }

    /// Takes the depth of a view's photo.
    fn insert(&mut self, view: usize, depth: PhotoDisparity, source: DepthSource, started: Instant) {
        self.sources[view] = (source, started.elapsed());
        self.maps.insert(view, depth);
    }

    /// A view and those whose photos its own is matched with, nearest first.
    fn with_neighbours(&self, view: usize) -> Vec<usize> {
        assert!(!self.maps.held_out.contains(&view), "a view that is not held out");
        std::iter::once(view).chain(self.maps.neighbours(view)).collect()
    }

    /// Bytes of the depth of a view's photo; 0 if it is unknown.
    pub(crate) fn bytes(&self, view: usize) -> usize {
        let found = self.maps.get(view);
        found.map_or(0, |found| size_of_val(found.disparity.as_slice().expect("standard order")))
    }
}

/// Called before each search; returning `Break` ends it.
pub(crate) type OnSearch = Box<dyn FnMut(DepthProgress<'_>) -> ControlFlow<()> + Send>;

/// A folder of depths, with the digests of photos and what went wrong with its files.
pub(crate) struct DepthFiles {
    folder: DepthCache,
    /// Of each view's photo, once it has been loaded.
    digests: Vec<Option<PhotoDigest>>,
    notes: Vec<String>,
}

/// The depths with these views held out: those in memory, or none yet.
fn with_held_out<'a>(
    depth: &'a mut Option<SceneDepth>,
    views: &SceneViews,
    held_out: &[usize],
) -> Result<&'a mut SceneDepth, SynthesisError> {
    *depth = match depth.take().filter(|depth| depth.maps.held_out == held_out) {
        None => Some(SceneDepth::new(views, held_out)?),
        known => known,
    };
    Ok(depth.as_mut().expect("set just now"))
}
