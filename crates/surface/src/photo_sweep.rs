//! Matching cost with a photo as reference: the difference between the photo and its neighbours
//! warped onto a plane, or onto a band of planes.
//!
//! Per neighbour and cell, with e = (r, g, b) the neighbour's colour less the photo's (RGB in \[0,
//! 1\]; the neighbour's sample divided by its coverage) and s = (r + g) + b: 0.5·min((|r| + |g| +
//! |b|)/3, 0.15) + 1.5·min((|s right − s| + |s below − s|)/6, 0.05). A gradient towards a cell that
//! the neighbour does not see, or beyond the photo's right or lower edge, counts as 0. A cell is
//! seen where the coverage is above 0.5; one that is not costs 0.15, the maximum. Over the
//! neighbours: the mean of the two lowest costs. In units of 1/32768, rounded to nearest (halves to
//! even), as u16. No windows: they blur edges that the aggregation ([`crate::aggregate`]) preserves
//! (docs/design-log/surface-layers.md).
//!
//! All in f32; divisions by 3 and 6 are products with the rounded reciprocal; costs are summed in
//! ascending order.
//!
//! A photo is processed by tiles that stay in the cache; a tile that a neighbour does not see costs what
//! an unseen cell costs, without samples.

use std::ops::Range;

use glam::{DVec2, DVec3};
use ndarray::Array3;
use rayon::prelude::*;

use crate::grid::{Candidates, Grid, Planes, SEGMENT};
use liveview::geometry::PlaneSweep;
use liveview::warp::{NO_GAINS, RUN, RunCoverage, SamplePositions, WarpSource, round_to_i32, sample};

/// Units of the volume per unit of cost.
pub(crate) const COST_SCALE: f32 = 32768.0;
/// Weight and upper bound of the difference of colour.
const COLOUR_WEIGHT: f32 = 0.5;
const COLOUR_BOUND: f32 = 0.15;
/// Weight and upper bound of the difference of gradient.
const GRADIENT_WEIGHT: f32 = 1.5;
const GRADIENT_BOUND: f32 = 0.05;
/// Cost of a cell that the neighbour does not see.
const UNSEEN_COST: f32 = COLOUR_WEIGHT * COLOUR_BOUND + GRADIENT_WEIGHT * GRADIENT_BOUND;

/// Costs `[h, w, n]` of the n candidates of each cell of the reference; the sources are its
/// neighbours at the same scale. With `ranges`, tiles are searched at these alone
/// ([`crate::grid::tile_ranges`]); other planes cost what an unseen cell costs.
pub(crate) fn costs(
    reference: &Planes,
    sources: &[WarpSource<'_>],
    grid: &Grid,
    candidates: Candidates<'_>,
    ranges: Option<&Array3<u16>>,
) -> Vec<u16> {
    let count = candidates.count(grid);
    let mut volume = vec![0; reference.height * reference.width * count];
    Search { reference, sources, grid, candidates, ranges, count }.fill(None, &mut volume);
    volume
}

/// As [`costs`], of the cells of a mask alone, into `volume`; the costs of others are unspecified.
pub(crate) fn costs_in(
    mask: &[bool],
    reference: &Planes,
    sources: &[WarpSource<'_>],
    grid: &Grid,
    candidates: Candidates<'_>,
    volume: &mut Vec<u16>,
) {
    let count = candidates.count(grid);
    volume.resize(mask.len() * count, 0);
    Search { reference, sources, grid, candidates, ranges: None, count }.fill(Some(mask), volume);
}

/// The rows of a band from the first to the last that has a cell of the mask in a tile, where `counts` says so.
fn masked_rows(mask: &[bool], width: usize, left: usize, counts: impl Fn(usize, usize) -> bool) -> Range<usize> {
    let columns = left..(left + TILE_COLUMNS).min(width);
    let wanted = |y: &usize| columns.clone().any(|x| mask[y * width + x] && counts(*y, x));
    let mut rows = (0..mask.len() / width).filter(wanted);
    let Some(first) = rows.next() else { return 0..0 };
    first..rows.next_back().unwrap_or(first) + 1
}

/// First columns of tiles that hold the cells of a mask.
fn tile_columns(mask: &[bool], width: usize) -> Vec<usize> {
    let mut columns: Vec<usize> = Vec::new();
    for x in (0..width).filter(|&x| mask[x..].iter().step_by(width).any(|&wanted| wanted)) {
        if columns.last().is_none_or(|last| x >= last + TILE_COLUMNS) {
            columns.push(x);
        }
    }
    columns
}

struct Search<'a> {
    reference: &'a Planes,
    sources: &'a [WarpSource<'a>],
    grid: &'a Grid,
    candidates: Candidates<'a>,
    ranges: Option<&'a Array3<u16>>,
    count: usize,
}

#[pulp::with_simd(search_band = liveview::simd::wide_arch())]
#[inline(always)]
fn search_band_with<'a, S: pulp::Simd>(
    simd: S,
    search: &'a Search<'a>,
    first: usize,
    columns: &'a [usize],
    mask: Option<&'a [bool]>,
    tile: &'a mut Tile,
    out: &'a mut [u16],
) {
    let Planes { width, height, .. } = *search.reference;
    for &left in columns {
        tile.column = left;
        for segment in search.segments(first / BAND_ROWS, left / TILE_COLUMNS) {
            let rows = match mask {
                None => 0..out.len() / (width * search.count),
                Some(mask) => masked_rows(mask, width, left, |y, x| search.has_segment(first + y, x, segment)),
            };
            (tile.first, tile.rows) = (first + rows.start, rows.len());
            tile.inside = first + rows.end < height && left + RUN <= width;
            if !rows.is_empty() && search.begin_segment(segment, tile) {
                // A closure would be compiled without the vector instructions.
                for k in 0..search.planes() {
                    search.candidate(simd, k, tile);
                }
                search.store(segment, tile, &mut out[rows.start * width * search.count..]);
            }
        }
    }
}

#[inline(always)]
fn lower(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

impl Search<'_> {
    /// Computes the costs of all cells, or of those of a mask.
    fn fill(&self, mask: Option<&[bool]>, volume: &mut [u16]) {
        let width = self.reference.width;
        let rows = if mask.is_some() { MASK_ROWS } else { BAND_ROWS };
        let bands = volume.par_chunks_mut(rows * width * self.count).enumerate();
        bands.for_each_init(
            || Box::new(Tile::NEW),
            |tile, (index, out)| {
                if self.ranges.is_some() {
                    out.fill(round_to_i32(UNSEEN_COST * COST_SCALE) as u16);
                }
                let mask = mask.map(|mask| &mask[index * rows * width..][..out.len() / self.count]);
                let all = || (0..width).step_by(TILE_COLUMNS).collect();
                let columns: Vec<usize> = mask.map_or_else(all, |mask| tile_columns(mask, width));
                search_band(self, index * rows, &columns, mask, tile, out);
            },
        );
    }

    /// Planes that are searched at together: a segment, or one of the candidates of each cell.
    fn planes(&self) -> usize {
        if matches!(self.candidates, Candidates::Own(_)) { 1 } else { SEGMENT }
    }

    /// The segments that a tile is searched at.
    fn segments(&self, row: usize, column: usize) -> std::ops::Range<usize> {
        let plane = |end: usize| self.ranges.map(|ranges| usize::from(ranges[(row, column, end)]));
        plane(0).unwrap_or(0) / SEGMENT..plane(1).unwrap_or(self.count) / self.planes()
    }

    /// Whether a cell is searched at a segment.
    fn has_segment(&self, y: usize, x: usize, segment: usize) -> bool {
        let Candidates::Segments { starts, columns, cells_per_side } = self.candidates else { return true };
        starts[y / cells_per_side * columns + x / cells_per_side][segment] != Candidates::NO_SEGMENT
    }

    /// Sets the index of each cell's first candidate of a segment; false where no cell of the tile
    /// has that segment.
    #[inline(always)]
    fn begin_segment(&self, segment: usize, tile: &mut Tile) -> bool {
        if let Candidates::Own(candidates) = self.candidates {
            tile.index_range = [f32::MAX, f32::MIN];
            for y in tile.sampled_rows(self.reference.height) {
                for (i, index) in tile.index[y - tile.first].iter_mut().enumerate() {
                    let x = (tile.column + i).min(self.reference.width - 1);
                    *index = candidates[y * self.reference.width + x][segment];
                    tile.index_range = [tile.index_range[0].min(*index), tile.index_range[1].max(*index)];
                }
            }
            return true;
        }
        let Candidates::Segments { starts, columns, cells_per_side } = self.candidates else {
            let first = (segment * SEGMENT) as f32;
            tile.index[..=tile.rows].fill([first; RUN]);
            tile.index_range = [first; 2];
            return true;
        };
        let (mut any, mut range) = (false, [u16::MAX, 0]);
        for y in tile.sampled_rows(self.reference.height) {
            let starts = &starts[y / cells_per_side * columns..][..columns];
            for (i, index) in tile.index[y - tile.first].iter_mut().enumerate() {
                let start = starts[((tile.column + i) / cells_per_side).min(columns - 1)][segment];
                any |= start != Candidates::NO_SEGMENT;
                let start = if start == Candidates::NO_SEGMENT { 0 } else { start };
                range = [range[0].min(start), range[1].max(start)];
                *index = f32::from(start);
            }
        }
        tile.index_range = range.map(f32::from);
        any
    }

    /// Computes the costs of the segment's `k`-th candidate, into `tile.costs`.
    #[inline(always)]
    fn candidate<S: pulp::Simd>(&self, simd: S, k: usize, tile: &mut Tile) {
        let averaged = self.sources.len().min(BEST_NEIGHBOURS);
        let Planes { width, height, .. } = *self.reference;
        let (columns, rows) = (tile.column..(tile.column + RUN).min(width), tile.sampled_rows(height));
        let disparities = tile.index_range.map(|index| self.grid.disparity(index + k as f32));
        for (index, source) in self.sources.iter().enumerate() {
            if is_unseen(source, &columns, &rows, disparities) {
                for row in 0..tile.rows {
                    tile.merge(row, [UNSEEN_COST; RUN], averaged, index == 0);
                }
                continue;
            }
            let all_seen = self.differences(simd, source, k as f32, tile);
            if all_seen && tile.inside {
                keep_lowest::<true>(averaged, index == 0, tile);
            } else {
                keep_lowest::<false>(averaged, index == 0, tile);
            }
        }
        let scale = COST_SCALE / averaged as f32;
        for row in 0..tile.rows {
            let mut sum = tile.lowest[0][row];
            for list in &tile.lowest[1..averaged] {
                (0..RUN).for_each(|i| sum[i] += list[row][i]);
            }
            let costs = &mut tile.costs[k][row];
            // Below 2^16, so that the conversion need not check for overflow.
            (0..RUN).for_each(|i| costs[i] = round_to_i32(sum[i] * scale) as u16);
        }
    }

    /// Computes the neighbour's colours less the photo's, on the tile's rows and the one below;
    /// returns whether the neighbour sees all of these cells.
    #[inline(always)]
    fn differences<S: pulp::Simd>(&self, simd: S, source: &WarpSource<'_>, k: f32, tile: &mut Tile) -> bool {
        let Planes { width, height, .. } = *self.reference;
        let (mut samples, mut disparity, mut all_seen) = ([[0.0; RUN]; 4], [0.0; RUN], true);
        let run = tile.column..tile.column + RUN;
        for y in tile.sampled_rows(height) {
            let row = y - tile.first;
            let index = &tile.index[row];
            (0..RUN).for_each(|i| disparity[i] = self.grid.disparity(index[i] + k));
            let run_coverage = tile.positions.locate::<false>(source, y, &run, &disparity);
            let [colour, signed] = [&mut tile.colour[row], tile.signed[row].first_chunk_mut().expect("a run")];
            let seen: &mut TileRow = tile.seen[row].first_chunk_mut().expect("a run");
            if run_coverage == RunCoverage::None {
                (*colour, *signed, *seen) = ([0.0; RUN], [0.0; RUN], [0.0; RUN]);
                all_seen = false;
                continue;
            }
            sample(simd, source.texture, &tile.positions, NO_GAINS, samples.each_mut());
            let [red, green, blue, coverage] = &samples;
            let [r, g, b] = [0, 1, 2].map(|channel| self.reference.run(channel, y, tile.column));
            if run_coverage == RunCoverage::All {
                *seen = [1.0; RUN];
                for i in 0..RUN {
                    let (r, g, b) = (red[i] - r[i], green[i] - g[i], blue[i] - b[i]);
                    colour[i] = (r.abs() + g.abs()) + b.abs();
                    signed[i] = (r + g) + b;
                }
            } else {
                all_seen = false;
                for i in 0..RUN {
                    let sees = coverage[i] > 0.5;
                    let one = if sees { 1.0 } else { 0.0 };
                    let share = one / if sees { coverage[i] } else { 1.0 };
                    let r = red[i] * share - r[i] * one;
                    let g = green[i] * share - g[i] * one;
                    let b = blue[i] * share - b[i] * one;
                    colour[i] = (r.abs() + g.abs()) + b.abs();
                    signed[i] = (r + g) + b;
                    seen[i] = one;
                }
            }
            let beyond = (width - tile.column).min(RUN);
            seen[beyond..].fill(0.0);
        }
        if tile.first + tile.rows == height {
            tile.seen[tile.rows].fill(0.0);
        }
        all_seen
    }

    /// Copies the tile's costs of a segment to the volume.
    #[inline(always)]
    fn store(&self, segment: usize, tile: &Tile, out: &mut [u16]) {
        let (width, count) = (self.reference.width, self.count);
        for row in 0..tile.rows {
            let costs: [&[u16; RUN]; SEGMENT] = std::array::from_fn(|k| &tile.costs[k][row]);
            let cells = out[(row * width + tile.column) * count..].chunks_exact_mut(count);
            for (i, cell) in cells.enumerate().take(TILE_COLUMNS.min(width - tile.column)) {
                let costs: [u16; SEGMENT] = std::array::from_fn(|k| costs[k][i]);
                let planes = self.planes();
                cell[segment * planes..(segment + 1) * planes].copy_from_slice(&costs[..planes]);
            }
        }
    }
}

/// Merges the cost of each cell in one neighbour (`first`: of the first neighbour) into the lists
/// of the `averaged` lowest. `INSIDE`: the neighbour sees all cells, none on the photo's edge.
#[inline(always)]
fn keep_lowest<const INSIDE: bool>(averaged: usize, first: bool, tile: &mut Tile) {
    for row in 0..tile.rows {
        let [here, below] = [&tile.signed[row], &tile.signed[row + 1]];
        let [seen, seen_below] = [&tile.seen[row], &tile.seen[row + 1]];
        let colour = &tile.colour[row];
        let mut cost = [0.0; RUN];
        for i in 0..RUN {
            let (mut right, mut down) = ((here[i + 1] - here[i]).abs(), (below[i] - here[i]).abs());
            if !INSIDE {
                (right, down) = (right * seen[i + 1], down * seen_below[i]);
            }
            let gradient = (right + down) * (1.0 / 6.0);
            let sum = COLOUR_WEIGHT * lower(colour[i] * (1.0 / 3.0), COLOUR_BOUND)
                + GRADIENT_WEIGHT * lower(gradient, GRADIENT_BOUND);
            cost[i] = if INSIDE || seen[i] > 0.0 { sum } else { UNSEEN_COST };
        }
        tile.merge(row, cost, averaged, first);
    }
}

/// Rows that one task processes at a time.
pub(crate) const BAND_ROWS: usize = 24;
/// The same of the cells of a mask.
const MASK_ROWS: usize = 8;
/// Rows of a tile: those of a band and the one below, for vertical gradients.
const TILE_ROWS: usize = BAND_ROWS + 1;
/// Columns from one tile to the next: the last column of a run has no right neighbour.
pub(crate) const TILE_COLUMNS: usize = RUN - 1;
/// Number of neighbours whose costs are averaged: those that match best, so that occlusion in the
/// others does not matter.
const BEST_NEIGHBOURS: usize = 2;

/// Distance from the neighbour's photo from which on a position is outside, pixels: a sample half a
/// pixel outside has a share of the photo, and positions are rounded by some millionths.
const MARGIN: f64 = 1.0;

/// A value at each column of a tile.
type TileRow = [f32; RUN];

/// Part of a band: a run of columns, of which all but the last have a right neighbour.
struct Tile {
    /// First row of the band.
    pub(crate) first: usize,
    /// Rows of the band.
    pub(crate) rows: usize,
    /// First column.
    pub(crate) column: usize,
    /// Whether no cell lies on the photo's right or lower edge.
    pub(crate) inside: bool,
    /// First index of the segment at each cell.
    pub(crate) index: [TileRow; TILE_ROWS],
    /// The smallest and the largest of them.
    index_range: [f32; 2],
    /// Sum over the channels of the absolute difference of colour.
    pub(crate) colour: [TileRow; TILE_ROWS],
    /// Sum over the channels of the signed difference; one more column, which stays 0.
    signed: [[f32; RUN + 1]; TILE_ROWS],
    /// 1 where the neighbour sees the cell, else 0; one more column, which stays 0.
    pub(crate) seen: [[f32; RUN + 1]; TILE_ROWS],
    /// Lowest costs over the neighbours so far, ascending.
    pub(crate) lowest: [[TileRow; BAND_ROWS]; BEST_NEIGHBOURS],
    /// Costs of a segment's candidates, in units of the volume.
    pub(crate) costs: [[[u16; RUN]; BAND_ROWS]; SEGMENT],
    pub(crate) positions: SamplePositions,
}

impl Tile {
    pub(crate) const NEW: Self = Self {
        first: 0,
        rows: 0,
        column: 0,
        inside: false,
        index: [[0.0; RUN]; TILE_ROWS],
        index_range: [0.0; 2],
        colour: [[0.0; RUN]; TILE_ROWS],
        signed: [[0.0; RUN + 1]; TILE_ROWS],
        seen: [[0.0; RUN + 1]; TILE_ROWS],
        lowest: [[[0.0; RUN]; BAND_ROWS]; BEST_NEIGHBOURS],
        costs: [[[0; RUN]; BAND_ROWS]; SEGMENT],
        positions: SamplePositions::NEW,
    };

    /// Its rows and the one below, without rows below a photo of that height.
    #[inline(always)]
    fn sampled_rows(&self, height: usize) -> Range<usize> {
        self.first..(self.first + self.rows + 1).min(height)
    }

    /// Merges a row's costs in one neighbour (`first`: in the first one) into its lists of the
    /// `averaged` lowest.
    #[inline(always)]
    fn merge(&mut self, row: usize, mut cost: TileRow, averaged: usize, first: bool) {
        for (index, list) in self.lowest.iter_mut().take(averaged).enumerate() {
            let list = &mut list[row];
            if first {
                *list = if index == 0 { cost } else { [f32::MAX; RUN] };
                continue;
            }
            for i in 0..RUN {
                let (held, new) = (list[i], cost[i]);
                (list[i], cost[i]) = if new < held { (new, held) } else { (held, new) };
            }
        }
    }
}

/// Whether the neighbour sees none of these columns and rows at any disparity from one to the
/// other (1/scene unit). The corners lie in front of it and beyond the same side of its photo; so
/// do all points between them. May be false where it sees none.
#[inline(always)]
fn is_unseen(neighbour: &WarpSource<'_>, columns: &Range<usize>, rows: &Range<usize>, disparities: [f32; 2]) -> bool {
    let PlaneSweep { homography_at_infinity: homography, epipole } = neighbour.sweep;
    let (mut least, mut most) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for column in [columns.start, columns.end] {
        for row in [rows.start, rows.end] {
            let corner = homography * DVec3::new(column as f64, row as f64, 1.0);
            for disparity in disparities {
                let at = corner + epipole * f64::from(disparity);
                if at.z <= 0.0 || at.z.is_nan() {
                    return false;
                }
                let at = DVec2::new(at.x / at.z, at.y / at.z);
                (least, most) = (least.min(at), most.max(at));
            }
        }
    }
    let (width, height) = (neighbour.texture.width() as f64, neighbour.texture.height() as f64);
    most.x < -MARGIN || most.y < -MARGIN || least.x > width + MARGIN || least.y > height + MARGIN
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use liveview::image::ImageRgb;
    use liveview::warp::Texture;

    #[test]
    fn only_what_lies_beyond_one_side_at_all_disparities_is_unseen() {
        let texture = Texture::new(&ImageRgb::new(40, 30, vec![0.5; 3 * 40 * 30]).unwrap());
        let sweep = |homography, epipole| PlaneSweep { homography_at_infinity: homography, epipole };
        let unseen = |homography, epipole, disparities| {
            is_unseen(&WarpSource::new(&texture, sweep(homography, epipole)), &(0..20), &(0..10), disparities)
        };
        for (x, y) in [(100.0, 0.0), (-100.0, 0.0), (0.0, 100.0), (0.0, -100.0)] {
            let epipole = DVec3::new(x, y, 0.0);
            assert!(unseen(DMat3::IDENTITY, epipole, [0.5, 0.5]), "{x} {y}");
            assert!(!unseen(DMat3::IDENTITY, epipole, [0.01, 0.5]), "{x} {y}: seen at one end");
        }
        // Beyond the left side at one end and the right side at the other: seen between.
        let shifted = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -60.0, 0.0, 1.0]);
        assert!(!unseen(shifted, DVec3::X, [0.0, 200.0]));
        assert!(unseen(shifted, DVec3::X, [0.0, 10.0]));
        // Half a pixel outside is in reach of a sample.
        assert!(!unseen(DMat3::IDENTITY, DVec3::X, [40.5, 40.5]));
        assert!(unseen(DMat3::IDENTITY, DVec3::X, [41.5, 41.5]));
        // Behind the neighbour, or partly so.
        let behind = DMat3::from_cols_array(&[1.0, 0.0, 0.1, 0.0, 1.0, 0.0, -60.0, 0.0, -1.0]);
        assert!(!unseen(behind, DVec3::ZERO, [0.0, 0.0]));
        assert!(!unseen(DMat3::IDENTITY, DVec3::NAN, [1.0, 1.0]));
    }
}
