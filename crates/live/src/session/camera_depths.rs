//! The depth of each camera's photo, kept from step to step: where photos change it follows them
//! ([`FollowedDepth`]), or each photo is searched once.
//!
//! A camera's depth belongs to its photo alone; its neighbours only help to find it. Where a photo
//! stays the same, its depth is reused, whatever changes in other photos and wherever the target
//! moves.

use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock};

use liveview::geometry::{Camera, facing_alike};
use liveview::image::ImageRgb;
use liveview::warp::{SourceView, Texture};
use liveview_surface::{
    ConfirmedDisparity, DepthMaps, EXTRA_PHOTOS, FollowedDepth, NEIGHBOURS, PhotoDisparity, Reuse, StepPhoto,
    photo_depth,
};
use liveview_synthesizer::PhotosWithDepth;
use rayon::prelude::*;

/// Where more than this share of the photos is searched, they show something else: a cut.
const NEW_SHARE: f64 = 0.75;
/// The depth of the nearest photos follows in each step, that of the others in every second.
const NEAREST: usize = 2;
/// Neighbours that depth is found from where it is coarse.
const COARSE_NEIGHBOURS: usize = 3;

/// Depth maps of the cameras of a rig.
#[derive(Debug)]
pub struct CameraDepths {
    maps: DepthMaps,
    followed: Vec<FollowedDepth>,
    /// The time step of each, by [`Self::confirmed`].
    followed_to: Vec<Option<usize>>,
    steps: usize,
}

impl CameraDepths {
    /// Of these cameras, to be searched from near to far (scene units).
    pub fn new(cameras: Vec<Camera>, (near, far): (f64, f64)) -> Self {
        let followed = cameras.iter().map(|_| FollowedDepth::default()).collect();
        let followed_to = vec![None; cameras.len()];
        Self { maps: DepthMaps::new(cameras, near, far), followed, followed_to, steps: 0 }
    }

    /// The depth of a camera's photo of a time step, and where those of its neighbours confirm it, which follow their photos too:
    /// one per camera, `None` where there is none.
    pub fn confirmed(
        &mut self,
        step: usize,
        camera: usize,
        photos: &[Option<Arc<ImageRgb>>],
    ) -> Option<(Arc<PhotoDisparity>, ConfirmedDisparity)> {
        photos[camera].as_ref()?;
        self.maps.held_out = (0..photos.len()).filter(|&camera| photos[camera].is_none()).collect();
        let mut late = self.maps.neighbours(camera);
        late.push(camera);
        late.retain(|&camera| self.followed_to[camera] != Some(step));
        if !late.is_empty() {
            let (cameras, photos) =
                (self.maps.cameras().to_vec(), photos.iter().map(Option::as_deref).collect::<Vec<_>>());
            self.follow(&Step::new(&cameras, &photos), &late, |_| false, false);
            late.iter().for_each(|&camera| self.followed_to[camera] = Some(step));
        }
        self.maps.confirmed_by_neighbours(camera)
    }

    /// The photos of a time step near the target, with their depth: searched where there is none yet, and
    /// where `reuse` says. The frame is rendered from the nearest ones, `rendered_from`. Depth that `follows`
    /// does without further photos, and may be `coarse`.
    pub(super) fn photos<'a>(
        &'a mut self,
        step: &'a Step<'_>,
        target: &Camera,
        rendered_from: usize,
        reuse: Reuse,
        follows: bool,
        coarse: bool,
    ) -> PhotosWithDepth<'a> {
        if reuse == Reuse::Nothing {
            self.maps.retain(&[], &[]);
            self.followed.fill_with(FollowedDepth::default);
        }
        let mut set = step.nearest(target);
        set.truncate(rendered_from + if follows { 0 } else { EXTRA_PHOTOS });
        let wanted: Vec<usize> = (0..self.followed.len())
            .filter(|camera| set.contains(camera) && (reuse == Reuse::Refreshed || self.maps.get(*camera).is_none()))
            .collect();
        let searched = if follows {
            self.steps += 1;
            let first = NEAREST + self.steps % 2;
            let waits = |camera| set.iter().skip(first).step_by(2).any(|&other| other == camera);
            self.follow(step, &wanted, waits, coarse)
        } else {
            let range = self.maps.range();
            for &camera in &wanted {
                let neighbours: Vec<_> = neighbours(step, camera).map(|other| step.source(other)).collect();
                let depth = match &neighbours[..] {
                    [] => PhotoDisparity::unknown(step.cameras[camera].size()),
                    neighbours => photo_depth(&step.source(camera), neighbours, range.0, range.1),
                };
                self.maps.insert(camera, depth);
            }
            wanted.len() as f64
        };
        PhotosWithDepth {
            maps: &mut self.maps,
            photos: set.iter().map(|&camera| (camera, step.source(camera))).collect(),
            rendered_from,
            searched: searched / set.len() as f64,
        }
    }

    /// Updates the depth of these cameras' photos; returns the sum of the shares that were searched.
    fn follow(&mut self, step: &Step<'_>, wanted: &[usize], waits: impl Fn(usize) -> bool + Sync, coarse: bool) -> f64 {
        let (number, range) = (if coarse { COARSE_NEIGHBOURS } else { NEIGHBOURS }, self.maps.range());
        let others = wanted.iter().flat_map(|&camera| neighbours(step, camera).take(number));
        let needed: BTreeSet<usize> = wanted.iter().copied().chain(others).collect();
        // Before the searches, which run in parallel and would wait for each other's photos.
        needed.into_par_iter().for_each(|camera| {
            step.smaller(camera);
        });
        let cameras = self.followed.par_iter_mut().enumerate().filter(|(camera, _)| wanted.contains(camera));
        let update = |(camera, followed): (usize, &mut FollowedDepth)| {
            let neighbours: Vec<_> = neighbours(step, camera).take(number).map(|other| step.photo(other)).collect();
            if neighbours.is_empty() {
                return (1.0, camera, Some(PhotoDisparity::unknown(step.cameras[camera].size())));
            }
            let searched = followed.update(&step.photo(camera), &neighbours, range, waits(camera), coarse);
            (searched, camera, (searched > 0.0).then(|| followed.depth()))
        };
        let updated: Vec<_> = cameras.map(update).collect();
        let searched: f64 = updated.iter().map(|(searched, ..)| searched).sum();
        let depths = updated.into_iter().filter_map(|(_, camera, depth)| Some((camera, depth?)));
        self.maps.update(depths, searched > NEW_SHARE * wanted.len() as f64);
        searched
    }
}

/// The cameras whose photos a camera's photo is matched with.
fn neighbours(step: &Step<'_>, camera: usize) -> impl Iterator<Item = usize> {
    let nearest = step.nearest(&step.cameras[camera]).into_iter();
    nearest.filter(move |&other| other != camera).take(NEIGHBOURS)
}

/// The photos of one time step; each becomes a texture when it is first needed.
pub(super) struct Step<'a> {
    pub(super) cameras: &'a [Camera],
    photos: &'a [Option<&'a ImageRgb>],
    textures: Vec<OnceLock<Texture>>,
    smaller: Vec<OnceLock<[Texture; 2]>>,
}

impl<'a> Step<'a> {
    pub(super) fn new(cameras: &'a [Camera], photos: &'a [Option<&'a ImageRgb>]) -> Self {
        let textures = photos.iter().map(|_| OnceLock::new()).collect();
        Self { cameras, photos, textures, smaller: photos.iter().map(|_| OnceLock::new()).collect() }
    }

    /// Number of cameras that have delivered a photo.
    pub(super) fn delivered(&self) -> usize {
        self.photos.iter().flatten().count()
    }

    /// The cameras that have delivered a photo and face the direction of this one, nearest first.
    pub(super) fn nearest(&self, camera: &Camera) -> Vec<usize> {
        let delivered: Vec<usize> = (0..self.photos.len()).filter(|&view| self.photos[view].is_some()).collect();
        let cameras: Vec<&Camera> = delivered.iter().map(|&view| &self.cameras[view]).collect();
        facing_alike(&cameras, camera).into_iter().map(|index| delivered[index]).collect()
    }

    /// A camera that has delivered a photo, and its texture.
    pub(super) fn source(&self, view: usize) -> SourceView<'_> {
        let texture = || Texture::new(self.photos[view].expect("delivered"));
        SourceView { camera: &self.cameras[view], texture: self.textures[view].get_or_init(texture) }
    }

    /// Its photo at half and at a quarter of its size.
    fn smaller(&self, view: usize) -> &[Texture; 2] {
        self.smaller[view].get_or_init(|| {
            let half = self.source(view).texture.shrunk(2);
            let quarter = half.shrunk(2);
            [half, quarter]
        })
    }

    fn photo(&self, view: usize) -> StepPhoto<'_> {
        let SourceView { camera, texture } = self.source(view);
        StepPhoto { camera, texture, smaller: self.smaller(view) }
    }
}
