//! The depth of one photo: a plane sweep with the photo as reference at half resolution, then a
//! narrow band around its result at full resolution.
//!
//! 1. All planes on cells of 2×2 pixels ([`super::cell_search`]).
//! 2. Pixels, planes half as far apart. Each cell has one or two segments of 8 of them, around the
//!    nearest and the farthest index n and f of its 3×3 neighbourhood, in steps of the finer grid,
//!    m = round((n + f)/2): where f − n < 3 one, from m − 3 on; where f − n < 10 two that join,
//!    from m − 7 on; else one from round(n) − 3 and one from round(f) − 4 on, not before the end of
//!    the first. All are shifted to lie on the grid. The same costs, aggregation and median.

use rayon::prelude::*;

use super::cell_search::{CellSearch, smooth_index};
use super::depth_map::PhotoDepth;
use super::grid::{Candidates, SEGMENT};
use super::photo_sweep::costs;
use super::planes::Planes;
use liveview::geometry::PlaneSweep;
use liveview::warp::{SourceView, WarpSource};

/// Pixels per side of a cell of the first search.
pub(crate) const CELL: usize = 2;
/// Planes of the second search per plane of the first.
pub(crate) const FINE_PER_COARSE: usize = 2;

/// Searches the depth of `photo` among its `neighbours` (at least one), from `near` to `far` (scene
/// units).
pub fn photo_depth(photo: &SourceView<'_>, neighbours: &[SourceView<'_>], near: f64, far: f64) -> PhotoDepth {
    let views: Vec<_> = std::iter::once(photo).chain(neighbours).copied().collect();
    refined(&views, CellSearch::of_full_size(&views, CELL, (near, far), || None))
}

/// The second search of the first of these photos, around the result of the first search.
pub(crate) fn refined(views: &[SourceView<'_>], first: CellSearch) -> PhotoDepth {
    let (photo, neighbours) = views.split_first().expect("a photo");
    let CellSearch { photo: cells, grid, index, disparity_per_pixel, .. } = first;
    let fine = grid.divided(FINE_PER_COARSE);
    let starts = segment_starts(&index, cells.width, FINE_PER_COARSE, fine.count);
    let candidates = Candidates::Segments { starts: &starts, columns: cells.width, cells_per_side: CELL };
    let reference = Planes::new(photo.texture);
    let source = |n: &SourceView<'_>| PlaneSweep::new(n.camera, photo.camera);
    let sources: Vec<_> = neighbours.iter().map(|n| WarpSource::new(n.texture, source(n))).collect();
    let volume = costs(&reference, &sources, &fine, candidates, None);
    let index = smooth_index(&volume, &reference, &fine, candidates);
    PhotoDepth::at(&index, reference.width, &fine, disparity_per_pixel)
}

/// First indices of the two segments of each cell, from the coarse indices that were found (rows
/// `width` wide). The finer grid has `count` indices, `fine_per_coarse` for each coarse one.
pub(crate) fn segment_starts(index: &[f32], width: usize, fine_per_coarse: usize, count: usize) -> Vec<[u16; 2]> {
    let (height, segment) = (index.len() / width, SEGMENT as f32);
    let mut starts = vec![[0; 2]; index.len()];
    starts.par_chunks_mut(width).enumerate().for_each(|(y, starts)| {
        for (x, starts) in starts.iter_mut().enumerate() {
            let (mut near, mut far) = (f32::MAX, f32::MIN);
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for &index in &index[row * width..][x.saturating_sub(1)..(x + 2).min(width)] {
                    (near, far) = (near.min(index), far.max(index));
                }
            }
            let (near, far) = (near * fine_per_coarse as f32, far * fine_per_coarse as f32);
            let last = (count.max(2 * SEGMENT) - 2 * SEGMENT) as f32;
            let middle = (0.5 * (near + far)).round();
            *starts = if far - near < 3.0 {
                [(middle - 3.0).clamp(0.0, last + segment) as u16, Candidates::NO_SEGMENT]
            } else if far - near < segment + 2.0 {
                let first = (middle - (segment - 1.0)).clamp(0.0, last) as u16;
                [first, first + SEGMENT as u16]
            } else {
                let first = (near.round() - 3.0).clamp(0.0, last) as u16;
                [first, ((far.round() - 4.0).min(last + segment) as u16).max(first + SEGMENT as u16)]
            };
        }
    });
    starts
}
