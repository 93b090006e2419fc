//! The target's surface: what the photos know of their depth, carried to the target, filled, and refined where it lands.
//!
//! 1. Splat of the confirmed depths of the main photos ([`super::splat`]); in its holes that of the further photos.
//! 2. Holes: the farthest neighbour, growing ([`super::holes`]), or what the guided search at the target finds among the first four
//!    views ([`crate::layers::guided`], its surface enlarged bilinearly): whichever the views that see it disagree less about over 7×7
//!    pixels ([`super::disagreement`]); the first unless the second has less than 0.9 of its disagreement − 1e-7. 3×3 median.
//! 3. Refined: seven offsets of 1.5, 1, … −1.5 px; disagreement over 3×3 pixels plus 2e-5·(offset in px)²; who sees what is told from
//!    the unrefined surface. The least (ties: the nearer), moved to the parabola's vertex (the first and the last stay), 3×3 median.
//!
//! px is the target's pixel of parallax: (1/near − 1/far) over the parallax of near and far in the view that sees most of it (1 at
//! least).

use ndarray::Array2;
use rayon::prelude::*;

use super::disagreement::{Views, disagreement};
use super::holes::grown;
use super::median::median3;
use super::splat::splat;
use super::visibility::visible;
use super::{
    Camera, KnownDepth, Layers, LayersError, PhotoDepth, PlaneSweep, Settings, SourceView, WarpSource, neighbourhood,
    padded, parallax,
};

/// A photo with what is known of its depth.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceView<'a> {
    /// Camera and photo.
    pub view: SourceView<'a>,
    /// All that its search found.
    pub all: &'a PhotoDepth,
    /// What other photos confirm of it.
    pub known: &'a KnownDepth,
}

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
    /// `count` layers near → far: one follows the surface; more divide the range between its largest and its smallest disparity
    /// over 3×3 pixels evenly (k-th of L: near + k/(L − 1)·(far − near), in f32).
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for none.
    pub fn layers(&self, count: usize) -> Result<Layers, LayersError> {
        if count <= 1 {
            return Layers::pixels(vec![self.disparity.clone(); count]);
        }
        let pick = |larger: bool| {
            neighbourhood(&self.disparity, |n| {
                n.into_iter().reduce(|a, b| if (a > b) == larger { a } else { b }).unwrap_or_default()
            })
        };
        let (near, far) = (pick(true), pick(false));
        let layer = |k: usize| {
            let share = k as f32 / (count - 1) as f32;
            let between = |&near: &f32, &far: &f32| if k + 1 == count { far } else { near + share * (far - near) };
            ndarray::Zip::from(&near).and(&far).map_collect(between)
        };
        Layers::pixels((0..count).map(layer).collect())
    }
}

/// Finds the surface of `target`.
pub fn surface(
    views: &[SurfaceView<'_>],
    main: usize,
    target: &Camera,
    near: f64,
    far: f64,
    settings: &Settings,
) -> Surface {
    let (views, further) = views.split_at(main.min(views.len()));
    let size = padded(target.size());
    let width = size.width;
    let sources: Vec<_> = views
        .iter()
        .map(|v| WarpSource { texture: v.view.texture, sweep: PlaneSweep::new(v.view.camera, target) })
        .collect();
    let sweeps: Vec<_> = sources.iter().map(|source| source.sweep).collect();
    let pixel = ((1.0 / near - 1.0 / far) / parallax(&sweeps, size, near, far).max(1.0)) as f32;
    let known: Vec<_> = views.iter().map(|v| (v.view.camera, v.known)).collect();
    let seen = |map: &[f32]| -> Vec<Vec<f32>> {
        known.par_iter().map(|&view| visible(view, target, map, width, settings.hides * pixel)).collect()
    };

    let mut map = splat(&known, target, size, settings.fuse * pixel);
    if !further.is_empty() && map.iter().any(|&d| d < 0.0) {
        let further: Vec<_> = further.iter().map(|v| (v.view.camera, v.known)).collect();
        let more = splat(&further, target, size, settings.fuse * pixel);
        map.iter_mut().zip(more).for_each(|(d, more)| *d = if *d < 0.0 { more } else { *d });
    }
    let map = map;
    let empty = map.iter().filter(|&&d| d < 0.0).count();
    let near_edges = grown(&map, width);
    let mut filled = near_edges;
    if empty > 0 && settings.second {
        let searched = settings.searched.then(|| {
            let pass = crate::layers::guided::GuidedSearch::new(near, far);
            let count = sources.len().min(4);
            let found = pass.search(&sources[..count], size).expect("a range that is one");
            let mut full = vec![0.0; map.len()];
            crate::layers::enlarge(found.range.surface().view(), 2, width, &mut full);
            full
        });
        let whole: Vec<KnownDepth> = views.iter().map(|v| KnownDepth { disparity: v.all.disparity.clone() }).collect();
        let all: Vec<_> = views.iter().zip(&whole).map(|(v, map)| (v.view.camera, map)).collect();
        let all = searched.unwrap_or_else(|| grown(&splat(&all, target, size, settings.fuse * pixel), width));
        let cost = |map: &[f32]| {
            let visible = seen(map);
            disagreement(&Views { sources: &sources, visible: &visible }, map, width, &[0.0], 3).remove(0)
        };
        let (first, second) = (cost(&filled), cost(&all));
        for at in 0..map.len() {
            if map[at] < 0.0 && second[at] < BETTER * first[at] - ROUNDING {
                filled[at] = all[at];
            }
        }
    }
    let mut surface = median3(&filled, width);
    let judges = settings.judges.min(sources.len());
    for _ in 0..settings.refine {
        surface = refined(&surface, &sources[..judges], &seen(&surface)[..judges], width, pixel, settings);
    }
    Surface {
        disparity: Array2::from_shape_vec((size.height, size.width), surface).expect("one per pixel"),
        pixel,
        holes: empty as f64 / map.len() as f64,
    }
}

/// Share of the first candidate's disagreement that the second must stay below to fill a hole.
const BETTER: f32 = 0.9;
/// And by how much: rounding, which is all that differs where the photos have no texture (a tenth of a grey level, squared).
const ROUNDING: f32 = 1e-7;
/// Offsets tried, in pixels of parallax, near → far.
const OFFSETS: [f32; 7] = [1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -1.5];

pub(super) fn refined(
    surface: &[f32],
    sources: &[WarpSource<'_>],
    visible: &[Vec<f32>],
    width: usize,
    pixel: f32,
    settings: &Settings,
) -> Vec<f32> {
    let offsets = OFFSETS.map(|offset| offset * pixel);
    let costs = disagreement(&Views { sources, visible }, surface, width, &offsets, settings.refine_radius);
    let mut found = vec![0.0; surface.len()];
    found.par_chunks_mut(width).enumerate().for_each(|(y, found)| {
        for (x, found) in found.iter_mut().enumerate() {
            let at = y * width + x;
            let cost: [f32; 7] = std::array::from_fn(|k| costs[k][at] + settings.stay * OFFSETS[k] * OFFSETS[k]);
            let mut best = 0;
            (1..7).for_each(|k| best = if cost[k] < cost[best] { k } else { best });
            let mut offset = OFFSETS[best];
            if best > 0 && best < 6 {
                let curvature = cost[best - 1] - 2.0 * cost[best] + cost[best + 1];
                let shift = if curvature > 0.0 { 0.5 * (cost[best - 1] - cost[best + 1]) / curvature } else { 0.0 };
                offset -= 0.5 * shift;
            }
            *found = (surface[at] + offset * pixel).max(0.0);
        }
    });
    median3(&found, width)
}
