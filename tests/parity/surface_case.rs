//! A golden file of surface layers.

use std::ops::Deref;

use liveview::geometry::PlaneSweep;
use liveview::surface::stages::target_disparity_per_pixel;
use liveview::surface::{ConfirmedDepth, NEIGHBOURS, PhotoDepth, SurfaceView};
use liveview::warp::{SourceView, WarpSource};

use crate::golden::{Case, flat};

/// A golden file of surface layers, with the depth range (scene units) and the number of planes of
/// the search.
pub(crate) struct SurfaceCase {
    case: Case,
    pub(crate) range: (f64, f64),
    pub(crate) count: usize,
}

impl Deref for SurfaceCase {
    type Target = Case;

    fn deref(&self) -> &Case {
        &self.case
    }
}

impl SurfaceCase {
    pub(crate) fn open(name: &'static str) -> Self {
        let case = Case::open(Some("surface"), name);
        let range = case.get::<f64>("range");
        let (range, count) = ((range[[0]], range[[1]]), flat(case.get::<i64>("count"))[0] as usize);
        Self { case, range, count }
    }

    pub(crate) fn into_failures(self) -> Vec<String> {
        self.case.into_failures()
    }

    /// Neighbours of photo `which`.
    pub(crate) fn neighbours(&self, which: usize) -> Vec<SourceView<'_>> {
        (0..self.cameras.len()).filter(|&i| i != which).take(NEIGHBOURS).map(|i| self.view(i)).collect()
    }

    pub(crate) fn depths(&self) -> Vec<PhotoDepth> {
        let pixels = self.get::<f32>("pixel");
        let depth =
            |i: usize| PhotoDepth { disparity: self.map(&format!("depth{i}")), disparity_per_pixel: pixels[[i]] };
        (0..self.cameras.len()).map(depth).collect()
    }

    /// The maps of photo 0's group of so many photos, and what is confirmed of them.
    pub(crate) fn group(&self, photos: usize) -> (Vec<PhotoDepth>, Vec<ConfirmedDepth>) {
        let pixels = self.get::<f32>("coarse_pixel");
        let of_photo = |i: usize| {
            let map = PhotoDepth { disparity: self.map(&format!("coarse{i}")), disparity_per_pixel: pixels[[i]] };
            let sure = self.map(&format!("coarse_sure{i}")).mapv(|yes| yes > 0.0);
            (map.clone(), ConfirmedDepth::new(&map, &sure))
        };
        (0..photos).map(of_photo).unzip()
    }

    fn confirmed(&self, depths: &[PhotoDepth]) -> Vec<ConfirmedDepth> {
        let confirmed =
            |(i, depth)| ConfirmedDepth::new(depth, &self.map(&format!("confirmed{i}")).mapv(|yes| yes > 0.0));
        depths.iter().enumerate().map(confirmed).collect()
    }

    /// `use_views` of the views with their confirmed depth.
    pub(crate) fn with_views<T>(&self, use_views: impl FnOnce(&[SurfaceView<'_>]) -> T) -> T {
        let depths = self.depths();
        let confirmed = self.confirmed(&depths);
        let gains = self.gains();
        let view = |i: usize| SurfaceView { view: self.view(i), confirmed: &confirmed[i], gains: gains[i] };
        use_views(&(0..depths.len()).map(view).collect::<Vec<_>>())
    }

    /// The views at the target, and which pixels of the surface they see.
    pub(crate) fn at_target(&self) -> (Vec<WarpSource<'_>>, Vec<Vec<f32>>) {
        let (gains, sweep) = (self.gains(), |i: usize| PlaneSweep::new(&self.cameras[i], &self.target));
        let source = |i: usize| WarpSource { gains: gains[i], ..WarpSource::new(&self.textures[i], sweep(i)) };
        let visible = self.volume::<f32>("visible");
        let visible = visible.outer_iter().map(|map| map.iter().copied().collect()).collect();
        ((0..self.cameras.len()).map(source).collect(), visible)
    }

    /// Disparity that moves a point by one pixel at the target.
    pub(crate) fn disparity_per_pixel(&self) -> f32 {
        self.with_views(|views| target_disparity_per_pixel(views, &self.target, self.range))
    }

    /// Exposure gains of each photo.
    fn gains(&self) -> Vec<[f32; 3]> {
        let gains = self.get::<f32>("gains");
        (0..self.cameras.len()).map(|view| std::array::from_fn(|channel| gains[[view, channel]])).collect()
    }
}
