//! The target's surface: what the photos know of their depth, carried to the target, its holes filled.
//!
//! 1. Splat of the confirmed depths ([`super::splat`]).
//! 2. Holes: the farthest neighbour, growing ([`super::holes`]). Where holes are more than a share of the target, what the guided
//!    search at the target finds among the first four views ([`crate::layers::guided`], its surface enlarged bilinearly) takes its
//!    place wherever those that see it disagree less about it over 7×7 pixels ([`super::photo_variance`]): less than 0.9 of the first
//!    one's photo_variance − 1e-7.
//! 3. 3×3 median.
//!
//! px is the target's pixel of parallax: (1/near − 1/far) over the parallax of near and far in the view that sees most of it (1 at
//! least).

use ndarray::Array2;
use rayon::prelude::*;

use super::photo_variance::{Views, photo_variance};
use super::splat::splat;
use super::surface_view::SurfaceView;
use super::visible::visible;
use crate::geometry::parallax::widest_parallax;
use crate::geometry::{Camera, PlaneSweep};
use crate::layers::guided::GuidedSearch;
use crate::layers::{CELL, Layers, LayersError, enlarge, padded};
use crate::surface::neighbourhood::{extremes3, fill_holes, median3};
use crate::surface::settings::Settings;
use crate::warp::{SourceView, WarpSource};

/// Disparity of each pixel of a padded target.
#[derive(Debug, Clone)]
pub struct Surface {
    /// 1/scene unit, `[h, w]`, multiples of 8.
    pub disparity: Array2<f32>,
    /// Disparity that is worth one pixel of parallax in the view that sees most of it.
    pub pixel: f32,
    /// Share of the target that no confirmed depth fell on.
    pub holes: f64,
}

impl Surface {
    /// `count` layers near → far: one follows the surface; two are its largest and its smallest disparity over 3×3 pixels, three
    /// these with the surface between them; more divide that range evenly (k-th of L: near + k/(L − 1)·(far − near), in f32).
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for none.
    pub fn layers(&self, count: usize) -> Result<Layers, LayersError> {
        if count <= 1 {
            return Layers::pixels(vec![self.disparity.clone(); count]);
        }
        let (height, width) = self.disparity.dim();
        let extremes = extremes3(self.disparity.as_slice().expect("standard order"), width);
        let [near, far] = [extremes.0, extremes.1]
            .map(|values| Array2::from_shape_vec((height, width), values).expect("one per pixel"));
        match count {
            2 => return Layers::pixels(vec![near, far]),
            3 => return Layers::pixels(vec![near, self.disparity.clone(), far]),
            _ => {}
        }
        let layer = |k: usize| {
            let share = k as f32 / (count - 1) as f32;
            let between = |&near: &f32, &far: &f32| if k + 1 == count { far } else { near + share * (far - near) };
            ndarray::Zip::from(&near).and(&far).map_collect(between)
        };
        Layers::pixels((0..count).map(layer).collect())
    }
}

/// Finds the surface of `target` from these photos, nearest first (one at least).
pub fn surface(views: &[SurfaceView<'_>], target: &Camera, near: f64, far: f64, settings: &Settings) -> Surface {
    let size = padded(target.size());
    let sources: Vec<_> = views
        .iter()
        .map(|v| {
            let SourceView { camera, texture } = v.view;
            WarpSource { texture, sweep: PlaneSweep::new(camera, target), gains: v.gains }
        })
        .collect();
    let sweeps: Vec<_> = sources.iter().map(|source| source.sweep).collect();
    let pixel = ((1.0 / near - 1.0 / far) / widest_parallax(&sweeps, size, near, far).max(1.0)) as f32;
    let known: Vec<_> = views.iter().map(|v| (v.view.camera, v.known)).collect();
    let splatted = splat(&known, target, size, (settings.agree * pixel, settings.fuse * pixel));
    let holes = splatted.iter().filter(|&&d| d < 0.0).count() as f64 / splatted.len() as f64;
    let mut filled = fill_holes(&splatted, size.width);
    if holes > settings.search_holes {
        let count = views.len().min(SEARCHED);
        let (sources, known) = (&sources[..count], &known[..count]);
        let found = GuidedSearch::new(near, far).search(sources, size).expect("a range that is one");
        let mut searched = vec![0.0; splatted.len()];
        enlarge(found.range.surface().view(), CELL, size.width, &mut searched);
        let cost = |map: &[f32]| {
            let see = |&view| visible(view, target, map, size.width, settings.hides * pixel);
            let visible: Vec<_> = known.par_iter().map(see).collect();
            photo_variance(&Views { sources, visible: &visible }, map, size.width, &splatted)
        };
        let (first, second) = (cost(&filled), cost(&searched));
        for (at, &splatted) in splatted.iter().enumerate() {
            if splatted < 0.0 && second[at] < BETTER * first[at] - ROUNDING {
                filled[at] = searched[at];
            }
        }
    }
    let disparity = median3(&filled, size.width);
    let disparity = Array2::from_shape_vec((size.height, size.width), disparity).expect("one per pixel");
    Surface { disparity, pixel, holes }
}

/// Views that holes are searched with.
const SEARCHED: usize = 4;
/// Share of the first candidate's photo_variance that the second must stay below to fill a hole.
const BETTER: f32 = 0.9;
/// And by how much: rounding, which is all that differs where the photos have no texture (a tenth of a grey level, squared).
const ROUNDING: f32 = 1e-7;
