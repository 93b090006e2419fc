//! Matching cost with a photo as reference: how far its neighbours, warped onto a plane or a band of planes, are from it.
//!
//! Per neighbour and cell, with e = (r, g, b) the neighbour's colour less the photo's (RGB in \[0, 1\]; the neighbour's sample divided
//! by its coverage) and s = (r + g) + b: 0.5·min((|r| + |g| + |b|)/3, 0.15) + 1.5·min((|s right − s| + |s below − s|)/6, 0.05). A
//! difference towards a cell that the neighbour does not see, or beyond the photo's right or lower edge, counts as 0. A cell is seen
//! where the coverage is above 0.5. This is averaged over the seen cells of a window of (2·radius + 1)² cells, clipped to the photo;
//! where no more than a fifth of (2·radius + 1)² cells are seen it is 0.15, the most there is. Over the neighbours: the mean of the
//! better half, rounded up (four at most), so that being hidden in some does not matter. In units of 1/32768, rounded to nearest
//! (halves to even), as u16.
//!
//! All in f32, divisions by 3, 6 and a whole window as products with the rounded reciprocal; a window's rows are added from above,
//! then its columns from the left; the kept costs from the least on.

use rayon::prelude::*;

use super::grid::{Candidates, Grid, SEGMENT};
use super::{RUN, RunCoverage, SamplePositions, Texture, WarpSource, sample};

/// One unit of cost, in units of the volume.
pub(super) const UNIT: f32 = 32768.0;
/// Weights and bounds of the differences of colour and of gradient.
const COLOUR: (f32, f32) = (0.5, 0.15);
const GRADIENT: (f32, f32) = (1.5, 0.05);
/// What an unseen cell costs.
const UNSEEN: f32 = COLOUR.0 * COLOUR.1 + GRADIENT.0 * GRADIENT.1;
/// RunCoverage cells of a window, as a share of all, from which on it is believed.
const SHARE: f32 = 0.2;
/// Rows that a thread takes at a time.
const BAND: usize = 24;
/// Largest radius of a window.
pub(super) const MAX_RADIUS: usize = 2;
/// Rows of a tile: those of a band, those that its windows reach, and the one below.
const ROWS: usize = BAND + 2 * MAX_RADIUS + 1;
/// Most neighbours whose costs are kept: the better half of 8.
const KEPT: usize = 4;
/// Zeros beside a run: what a window reaches to.
const LEAD: usize = 8;

/// A photo's colours by plane; a run of [`RUN`] may begin in any column.
pub(super) struct Planes {
    pub(super) width: usize,
    pub(super) height: usize,
    stride: usize,
    rgb: [Vec<f32>; 3],
}

impl Planes {
    pub(super) fn new(texture: &Texture) -> Self {
        let (width, height) = (texture.width(), texture.height());
        let (stride, texels) = (width + RUN, texture.upper_and_lower().0);
        let mut rgb = [(); 3].map(|()| vec![0.0; stride * height]);
        for y in 0..height {
            let row = &texels[(y + 1) * texture.stride() as usize + 1..][..width];
            for (channel, plane) in rgb.iter_mut().enumerate() {
                plane[y * stride..].iter_mut().zip(row).for_each(|(value, texel)| *value = texel[channel]);
            }
        }
        Self { width, height, stride, rgb }
    }

    /// A row of a channel, as wide as the photo.
    pub(super) fn row(&self, channel: usize, y: usize) -> &[f32] {
        &self.rgb[channel][y * self.stride..][..self.width]
    }

    /// Part of a row.
    #[inline(always)]
    fn run(&self, channel: usize, y: usize, x: usize) -> &[f32; RUN] {
        self.rgb[channel][y * self.stride + x..][..RUN].try_into().expect("a run")
    }
}

/// Costs `[h, w, n]` of the n candidates of each cell of the reference; sources are its neighbours at the same scale.
pub(super) fn costs(
    reference: &Planes,
    sources: &[WarpSource<'_>],
    grid: &Grid,
    candidates: Candidates<'_>,
    radius: usize,
) -> Vec<u16> {
    let count = candidates.count(grid);
    let mut volume = vec![0; reference.height * reference.width * count];
    let search = Search { reference, sources, grid, candidates, radius: radius.min(MAX_RADIUS), count };
    let bands = volume.par_chunks_mut(BAND * reference.width * count).enumerate();
    bands.for_each_init(|| Box::new(Tile::NEW), |tile, (index, out)| search_band(&search, index * BAND, tile, out));
    volume
}

struct Search<'a> {
    reference: &'a Planes,
    sources: &'a [WarpSource<'a>],
    grid: &'a Grid,
    candidates: Candidates<'a>,
    radius: usize,
    count: usize,
}

type Run = [f32; RUN];

/// Part of a band: a run of columns, of which those in the middle have whole windows.
struct Tile {
    /// First row of the band, and how many there are; first and last row (excluded) that the windows reach.
    first: usize,
    rows: usize,
    begin: usize,
    end: usize,
    /// First column sampled, first and last (excluded) found, as places in the run.
    column: usize,
    inner: (usize, usize),
    /// Whether no window meets the photo's edges.
    inside: bool,
    /// First index of the segment at each cell.
    index: [Run; ROWS],
    /// Sum of the channels' differences without and with their sign, and which cells are seen (1 or 0).
    colour: [Run; ROWS],
    signed: [[f32; RUN + LEAD]; ROWS],
    seen: [[f32; RUN + LEAD]; ROWS],
    cost: [Run; ROWS],
    sums: [[f32; RUN + 2 * LEAD]; 2],
    /// The least costs of the neighbours so far, ascending.
    kept: [[Run; BAND]; KEPT],
    found: [[[u16; RUN]; BAND]; SEGMENT],
    taps: SamplePositions,
}

impl Tile {
    const NEW: Self = Self {
        first: 0,
        rows: 0,
        begin: 0,
        end: 0,
        column: 0,
        inner: (0, 0),
        inside: false,
        index: [[0.0; RUN]; ROWS],
        colour: [[0.0; RUN]; ROWS],
        signed: [[0.0; RUN + LEAD]; ROWS],
        seen: [[0.0; RUN + LEAD]; ROWS],
        cost: [[0.0; RUN]; ROWS],
        sums: [[0.0; RUN + 2 * LEAD]; 2],
        kept: [[[0.0; RUN]; BAND]; KEPT],
        found: [[[0; RUN]; BAND]; SEGMENT],
        taps: SamplePositions::NONE,
    };
}

#[pulp::with_simd(search_band = pulp::Arch::new())]
#[inline(always)]
fn search_band_with<'a, S: pulp::Simd>(
    simd: S,
    search: &'a Search<'a>,
    first: usize,
    tile: &'a mut Tile,
    out: &'a mut [u16],
) {
    let Planes { width, height, .. } = *search.reference;
    let radius = search.radius;
    (tile.first, tile.rows) = (first, out.len() / (width * search.count));
    (tile.begin, tile.end) = (first.saturating_sub(radius), (first + tile.rows + radius).min(height));
    let step = RUN - 2 * radius - 1;
    for left in (0..width).step_by(step) {
        tile.column = left.saturating_sub(radius);
        let lead = left - tile.column;
        tile.inner = (lead, lead + step.min(width - left));
        let rows = first >= radius && first + tile.rows + radius < height;
        tile.inside = rows && left >= radius && tile.column + RUN <= width;
        for segment in 0..search.count / SEGMENT {
            if search.begin_segment(segment, tile) {
                // A closure would be compiled without the vector instructions.
                for k in 0..SEGMENT {
                    search.candidate(simd, k, tile);
                }
                search.store(segment, left, tile, out);
            }
        }
    }
}

#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

impl Search<'_> {
    /// The index of each cell's first candidate of a segment; false where no cell of the tile has that segment.
    #[inline(always)]
    fn begin_segment(&self, segment: usize, tile: &mut Tile) -> bool {
        let Candidates::Two { starts, columns, share } = self.candidates else {
            tile.index = [[(segment * SEGMENT) as f32; RUN]; ROWS];
            return true;
        };
        let mut any = false;
        for y in tile.begin..(tile.end + 1).min(self.reference.height) {
            let starts = &starts[y / share * columns..][..columns];
            for (i, index) in tile.index[y - tile.begin].iter_mut().enumerate() {
                let start = starts[((tile.column + i) / share).min(columns - 1)][segment];
                any |= start != Candidates::NONE;
                *index = f32::from(if start == Candidates::NONE { 0 } else { start });
            }
        }
        any
    }

    /// Costs of the segment's `k`-th candidate, into `tile.found`.
    #[inline(always)]
    fn candidate<S: pulp::Simd>(&self, simd: S, k: usize, tile: &mut Tile) {
        let kept = self.sources.len().div_ceil(2).min(KEPT);
        for (index, source) in self.sources.iter().enumerate() {
            let whole = self.differences(simd, source, k as f32, tile);
            if whole && tile.inside {
                pixel_costs::<true>(tile);
                self.window_costs::<true>(kept, index == 0, tile);
            } else {
                pixel_costs::<false>(tile);
                self.window_costs::<false>(kept, index == 0, tile);
            }
        }
        let scale = UNIT / kept as f32;
        for row in 0..tile.rows {
            let mut sum = tile.kept[0][row];
            for list in &tile.kept[1..kept] {
                (0..RUN).for_each(|i| sum[i] += list[row][i]);
            }
            let found = &mut tile.found[k][row];
            // Below 2^16, so that the conversion need not look for overflow.
            (0..RUN).for_each(|i| found[i] = super::whole(sum[i] * scale) as u16);
        }
    }

    /// The neighbour's colours less the photo's on the rows that the windows reach and the one below; whether it sees all of
    /// them.
    #[inline(always)]
    fn differences<S: pulp::Simd>(&self, simd: S, source: &WarpSource<'_>, k: f32, tile: &mut Tile) -> bool {
        let Planes { width, height, .. } = *self.reference;
        let (mut samples, mut disparity, mut all) = ([[0.0; RUN]; 4], [0.0; RUN], true);
        let run = tile.column..tile.column + RUN;
        for y in tile.begin..(tile.end + 1).min(height) {
            let row = y - tile.begin;
            let index = &tile.index[row];
            (0..RUN).for_each(|i| disparity[i] = self.grid.disparity(index[i] + k));
            let found = tile.taps.find(source, y, &run, &disparity);
            let [colour, signed] = [&mut tile.colour[row], tile.signed[row].first_chunk_mut().expect("a run")];
            let seen: &mut Run = tile.seen[row].first_chunk_mut().expect("a run");
            if found == RunCoverage::None {
                (*colour, *signed, *seen) = ([0.0; RUN], [0.0; RUN], [0.0; RUN]);
                all = false;
                continue;
            }
            sample(simd, source.texture, &tile.taps, samples.each_mut());
            let [red, green, blue, coverage] = &samples;
            let [r, g, b] = [0, 1, 2].map(|channel| self.reference.run(channel, y, tile.column));
            if found == RunCoverage::All {
                *seen = [1.0; RUN];
                for i in 0..RUN {
                    let (r, g, b) = (red[i] - r[i], green[i] - g[i], blue[i] - b[i]);
                    colour[i] = (r.abs() + g.abs()) + b.abs();
                    signed[i] = (r + g) + b;
                }
            } else {
                all = false;
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
        if tile.end == height {
            tile.seen[tile.end - tile.begin].fill(0.0);
        }
        all
    }

    /// Means over windows, into the lists of the least.
    #[inline(always)]
    fn window_costs<const WHOLE: bool>(&self, kept: usize, only: bool, tile: &mut Tile) {
        match self.radius {
            0 => window_costs::<WHOLE, 0>(kept, only, tile),
            1 => window_costs::<WHOLE, 1>(kept, only, tile),
            _ => window_costs::<WHOLE, 2>(kept, only, tile),
        }
    }

    /// The tile's costs of a segment, to their cells.
    #[inline(always)]
    fn store(&self, segment: usize, left: usize, tile: &Tile, out: &mut [u16]) {
        let (width, count) = (self.reference.width, self.count);
        for row in 0..tile.rows {
            let found: [&[u16; RUN]; SEGMENT] = std::array::from_fn(|k| &tile.found[k][row]);
            let cells = out[(row * width + left) * count..].chunks_exact_mut(count);
            for (i, cell) in (tile.inner.0..tile.inner.1).zip(cells) {
                let costs: [u16; SEGMENT] = std::array::from_fn(|k| found[k][i]);
                cell[segment * SEGMENT..(segment + 1) * SEGMENT].copy_from_slice(&costs);
            }
        }
    }
}

/// What each cell costs by itself, 0 where it is not seen.
#[inline(always)]
fn pixel_costs<const WHOLE: bool>(tile: &mut Tile) {
    for row in 0..tile.end - tile.begin {
        let [here, below] = [&tile.signed[row], &tile.signed[row + 1]];
        let [seen, seen_below] = [&tile.seen[row], &tile.seen[row + 1]];
        let (colour, cost) = (&tile.colour[row], &mut tile.cost[row]);
        let right: &Run = here[1..=RUN].try_into().expect("a run");
        let seen_right: &Run = seen[1..=RUN].try_into().expect("a run");
        for i in 0..RUN {
            let (mut right, mut down) = ((right[i] - here[i]).abs(), (below[i] - here[i]).abs());
            if !WHOLE {
                (right, down) = (right * seen_right[i], down * seen_below[i]);
            }
            let gradient = (right + down) * (1.0 / 6.0);
            let sum = COLOUR.0 * least(colour[i] * (1.0 / 3.0), COLOUR.1) + GRADIENT.0 * least(gradient, GRADIENT.1);
            cost[i] = if WHOLE { sum } else { sum * seen[i] };
        }
    }
}

#[inline(always)]
fn window_costs<const WHOLE: bool, const RADIUS: usize>(kept: usize, only: bool, tile: &mut Tile) {
    let enough = SHARE * ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
    let per_window = 1.0 / ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
    for row in 0..tile.rows {
        let y = tile.first + row;
        let top = y.saturating_sub(RADIUS).max(tile.begin) - tile.begin;
        let bottom = (y + RADIUS + 1).min(tile.end) - tile.begin;
        let (mut cost, mut seen) = (tile.cost[top], [0.0; RUN]);
        for row in &tile.cost[top + 1..bottom] {
            (0..RUN).for_each(|i| cost[i] += row[i]);
        }
        tile.sums[0][LEAD..LEAD + RUN].copy_from_slice(&cost);
        if !WHOLE {
            for row in &tile.seen[top..bottom] {
                (0..RUN).for_each(|i| seen[i] += row[i]);
            }
            tile.sums[1][LEAD..LEAD + RUN].copy_from_slice(&seen);
        }
        let mut mean = [0.0; RUN];
        let shifted = |which: usize, by: usize| -> &Run {
            tile.sums[which][LEAD - RADIUS + by..][..RUN].try_into().expect("a run")
        };
        let (mut total, mut number) = (*shifted(0, 0), *shifted(1, 0));
        for by in 1..=2 * RADIUS {
            let (sums, counts) = (shifted(0, by), shifted(1, by));
            (0..RUN).for_each(|i| total[i] += sums[i]);
            if !WHOLE {
                (0..RUN).for_each(|i| number[i] += counts[i]);
            }
        }
        for i in 0..RUN {
            mean[i] = if WHOLE {
                total[i] * per_window
            } else if number[i] > enough {
                total[i] / number[i]
            } else {
                UNSEEN
            };
        }
        for (index, list) in tile.kept.iter_mut().take(kept).enumerate() {
            let list = &mut list[row];
            if only {
                *list = if index == 0 { mean } else { [f32::MAX; RUN] };
                continue;
            }
            for i in 0..RUN {
                let (held, new) = (list[i], mean[i]);
                (list[i], mean[i]) = if new < held { (new, held) } else { (held, new) };
            }
        }
    }
}
