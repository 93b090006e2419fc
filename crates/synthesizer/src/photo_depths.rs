//! The depth of a scene's photos: searched when it is first needed, or read from a folder where an
//! earlier run has stored it.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::depth_search::SearchedPhoto;
use crate::{DepthSearch, FoundDepth, LoadedShot, PhotosWithDepth, ScenePhotos, SceneViews, Shot, SynthesisError};
use liveview::Camera;
use liveview_surface::cache::{DepthCache, PhotoDigest};
use liveview_surface::{ConfirmedDisparity, DepthMaps, PhotoDisparity, SmallMaps};

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

    /// The views of a shot whose photos' depth is not known: rendering it along the surface searches
    /// them.
    pub fn unknown_depths(&self, shot: &Shot) -> Vec<usize> {
        let known = self.depth.as_ref().filter(|depth| depth.maps.held_out == shot.held_out);
        shot.photos().filter(|&view| known.is_none_or(|depth| depth.maps.get(view).is_none())).collect()
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
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        if depth.maps.get(view).is_some() {
            return Ok(None);
        }
        let group = depth.with_neighbours(view);
        let searched: Vec<Vec<usize>> = group.iter().map(|&view| depth.with_neighbours(view)).collect();
        let all = searched.iter().flatten().copied();
        let further: BTreeSet<usize> = all.filter(|view| !group.contains(view)).collect();
        let files = self.files.as_ref();
        let photo = |&view: &usize| SearchedPhoto {
            view,
            texture: self.textures[view].clone(),
            digest: files.and_then(|files| files.digests[view]),
        };
        Ok(Some(DepthSearch {
            scene: Arc::clone(&self.views.scene),
            held_out: held_out.to_vec(),
            photos: group.iter().map(photo).collect(),
            further: further.iter().map(photo).collect(),
            searched,
            range: depth.maps.range(),
            comparison: depth.maps.comparison(view, compared),
            small_maps: Arc::clone(&depth.small_maps),
            folder: files.map(|files| files.folder.clone()),
        }))
    }

    /// Takes what a search found, unless other views are held out now.
    pub fn insert_depth(&mut self, found: FoundDepth) {
        let held_out = &found.held_out;
        let Some(depth) = self.depth.as_mut().filter(|depth| depth.maps.held_out == *held_out) else { return };
        depth.sources[found.view()] = (found.source, found.time);
        depth.maps.insert_compared(found.view(), found.depth, found.votes);
        for photo in &found.photos {
            if let Some(texture) = &photo.texture {
                self.textures[photo.view].get_or_insert_with(|| Arc::clone(texture));
            }
        }
        if let Some(files) = &mut self.files {
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
        let depth = with_held_out(&mut self.depth, &self.views, &shot.held_out)?;
        let photos = photos.iter().map(|photo| (photo.view, photo.source())).collect();
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
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        let wanted = depth.with_neighbours(view);
        self.find_all(held_out, &wanted)?;
        let depth = with_held_out(&mut self.depth, &self.views, held_out)?;
        let (source, time) = depth.sources[view];
        let (found, confirmed) = depth.maps.confirmed_by_neighbours(view).expect("found just now");
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

    /// As [`Self::view_depth`], moved to the nearer side at edges where the photo's neighbours show that: for a surface that is drawn.
    ///
    /// # Errors
    ///
    /// Those of [`Self::view_depth`].
    ///
    /// # Panics
    ///
    /// If there is no such view, or it is held out.
    pub fn edge_depth(
        &mut self,
        view: usize,
        held_out: &[usize],
        later: &[usize],
    ) -> Result<ViewDepth, SynthesisError> {
        let wanted = with_held_out(&mut self.depth, &self.views, held_out)?.with_neighbours(view);
        self.find_all(held_out, &wanted)?;
        let photos = self.load_views(&wanted)?;
        let photos: Vec<_> = photos.iter().map(|photo| (photo.view, photo.source())).collect();
        let maps = &mut with_held_out(&mut self.depth, &self.views, held_out)?.maps;
        let (found, confirmed) = maps.nearer_by_others(&photos);
        let depth = self.view_depth(view, held_out, later)?;
        Ok(ViewDepth { found: Arc::new(found), confirmed, ..depth })
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
            if let Some(search) = self.search(view, held_out, &[])? {
                self.insert_depth(search.run()?);
            }
        }
        Ok(())
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
    small_maps: Arc<SmallMaps>,
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
        Ok(Self { maps, small_maps: Arc::default(), sources })
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
