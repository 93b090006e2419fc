//! Semi-global aggregation of a photo's matching costs (Hirschmüller, 2008): four paths, with a
//! lower penalty for jumps at the photo's edges.
//!
//! Along a path (right, left, down, up) the cost of index d at a cell is L(d) = C(d) + min(L'(d),
//! L'(d − 1) + P1, L'(d + 1) + P1, m + P2) − m with L' of the previous cell and m its minimum; L =
//! C at the first cell. P1 = 0.01, P2 = max(0.12 / (1 + |ΔRGB| / 0.05), 1.01·P1), |ΔRGB| the mean
//! over the channels of the difference of colour from the previous cell, both in units of the
//! volume (1/32768), rounded to nearest (halves away from 0). L' is infinite (40,000) for an index
//! that the previous cell is not searched at.
//!
//! The cell's index is the one with the smallest sum over the four paths (ties: the nearer; planes
//! that only fill the last segment beyond the grid's end take part in the paths and are never
//! chosen). Where its two neighbours are candidates too it moves to the vertex of the parabola
//! through the three sums: by (a − c) / (2·(a − 2b + c)). Integers (u16); the parabola is in f32.

use rayon::prelude::*;

use super::grid::{Candidates, Grid, SEGMENT};
use super::path::{PathEnds, Paths, minimum};
use super::penalties::Penalties;
use super::planes::Planes;

/// Columns that one task processes down and up.
const BLOCK_COLUMNS: usize = 16;

/// A row of a block of columns: the sums of its cells, and the indices found.
type BlockRow<'a> = (&'a mut [u16], &'a mut [f32]);

/// The index found at each cell, `[h, w]`, a fraction between two of the grid.
pub(crate) fn aggregate(costs: &[u16], photo: &Planes, grid: &Grid, candidates: Candidates<'_>) -> Vec<f32> {
    let (width, count) = (photo.width, candidates.count(grid));
    let penalties = Penalties::new(photo);
    let paths = Paths { costs, penalties: &penalties, candidates, grid, width, count };
    let mut sums = vec![0; costs.len()];
    let rows = sums.par_chunks_mut(width * count).enumerate();
    rows.for_each_init(|| PathEnds::new(&paths, 1), |ends, (y, sums)| across(&paths, y, ends, sums));
    let mut found = vec![0.0; width * photo.height];
    let mut blocks: Vec<Vec<BlockRow<'_>>> = (0..width.div_ceil(BLOCK_COLUMNS)).map(|_| Vec::new()).collect();
    for (sums, found) in sums.chunks_mut(width * count).zip(found.chunks_mut(width)) {
        let parts = sums.chunks_mut(BLOCK_COLUMNS * count).zip(found.chunks_mut(BLOCK_COLUMNS));
        parts.zip(&mut blocks).for_each(|(part, block)| block.push(part));
    }
    blocks.par_iter_mut().enumerate().for_each_init(
        || PathEnds::new(&paths, BLOCK_COLUMNS),
        |ends, (index, block)| down_and_up(&paths, index * BLOCK_COLUMNS, ends, block),
    );
    found
}

/// Right and left along row `y`; `sums` becomes the sum of both paths.
#[pulp::with_simd(across = liveview::simd::arch())]
#[inline(always)]
fn across_with<'a, S: pulp::Simd>(
    _simd: S,
    paths: &'a Paths<'a>,
    y: usize,
    ends: &'a mut PathEnds,
    sums: &'a mut [u16],
) {
    sums.fill(0);
    let jumps = &paths.penalties.jump_across[y * paths.width..];
    for x in 0..paths.width {
        let from = (x > 0).then(|| ((y, x - 1), jumps[x]));
        paths.advance(0, from, (y, x), ends, &mut sums[x * paths.count..(x + 1) * paths.count]);
    }
    for x in (0..paths.width).rev() {
        let from = (x + 1 < paths.width).then(|| ((y, x + 1), jumps[x + 1]));
        paths.advance(0, from, (y, x), ends, &mut sums[x * paths.count..(x + 1) * paths.count]);
    }
}

/// Down and up the columns of a block, from `first` on, to the index of each cell.
#[pulp::with_simd(down_and_up = liveview::simd::arch())]
#[inline(always)]
fn down_and_up_with<'a, S: pulp::Simd>(
    _simd: S,
    paths: &'a Paths<'a>,
    first: usize,
    ends: &'a mut PathEnds,
    block: &'a mut [BlockRow<'_>],
) {
    let (height, count) = (block.len(), paths.count);
    let columns = block[0].1.len();
    let jumps = &paths.penalties.jump_down;
    for (y, (row, _)) in block.iter_mut().enumerate() {
        for i in 0..columns {
            let x = first + i;
            let from = (y > 0).then(|| ((y - 1, x), jumps[y * paths.width + x]));
            paths.advance(i, from, (y, x), ends, &mut row[i * count..(i + 1) * count]);
        }
    }
    for (y, (row, found)) in block.iter_mut().enumerate().rev() {
        for i in 0..columns {
            let x = first + i;
            let from = (y + 1 < height).then(|| ((y + 1, x), jumps[(y + 1) * paths.width + x]));
            let sums = &mut row[i * count..(i + 1) * count];
            paths.advance(i, from, (y, x), ends, sums);
            found[i] = best_index(paths, (y, x), sums);
        }
    }
}

/// The index of the smallest sum, refined by the parabola through its neighbours.
#[inline(always)]
fn best_index(paths: &Paths<'_>, cell: (usize, usize), sums: &[u16]) -> f32 {
    let end = match paths.candidates {
        Candidates::All => paths.grid.count,
        // The cell has no second segment.
        Candidates::Segments { .. } if sums[SEGMENT] == u16::MAX => SEGMENT,
        Candidates::Segments { .. } => sums.len(),
    };
    let smallest = minimum(&sums[..end]);
    let k = sums.iter().position(|&sum| sum == smallest).unwrap_or(0);
    let index = paths.candidates.index(cell, k);
    let is_adjacent = |other: usize| paths.candidates.index(cell, other).abs_diff(index) == 1;
    if k == 0 || k + 1 == end || !is_adjacent(k - 1) || !is_adjacent(k + 1) {
        return index as f32;
    }
    let [nearer, here, farther] = [sums[k - 1], sums[k], sums[k + 1]].map(f32::from);
    let curvature = nearer - 2.0 * here + farther;
    index as f32 + if curvature > 0.0 { 0.5 * (nearer - farther) / curvature } else { 0.0 }
}
