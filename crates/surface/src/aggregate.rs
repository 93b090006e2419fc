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

use crate::grid::{Candidates, Grid, OWN, PerOwn, Planes, SEGMENT};
use crate::photo_sweep::COST_SCALE;

/// Columns that one task processes down and up.
const BLOCK_COLUMNS: usize = 16;

/// A row of a block of columns: the sums of its cells, and the indices found.
type BlockRow<'a> = (&'a mut [u16], &'a mut [f32]);

/// The index found at each cell, `[h, w]`, a fraction between two of the grid.
pub(crate) fn aggregate(costs: &[u16], photo: &Planes, grid: &Grid, candidates: Candidates<'_>) -> Vec<f32> {
    aggregate_in(None, costs, photo, grid, candidates, &mut Vec::new())
}

/// The cells that are searched, and the index of the others, from which paths enter them: where that is k,
/// L' is 0 at k and infinite elsewhere.
pub(crate) type Known<'a> = (&'a [bool], &'a [f32]);

/// As [`aggregate`], of a part of the cells; 0 elsewhere. `sums` is a buffer.
pub(crate) fn aggregate_in(
    known: Option<Known<'_>>,
    costs: &[u16],
    photo: &Planes,
    grid: &Grid,
    candidates: Candidates<'_>,
    sums: &mut Vec<u16>,
) -> Vec<f32> {
    let (width, count) = (photo.width, candidates.count(grid));
    let penalties = Penalties::new(photo);
    let paths = Paths { costs, penalties: &penalties, candidates, grid, width, count, known };
    sums.resize(costs.len(), 0);
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
    let jumps = &paths.penalties.jump_across[y * paths.width..];
    for x in 0..paths.width {
        if paths.skips((y, x)) {
            continue;
        }
        let from = (x > 0).then(|| ((y, x - 1), jumps[x]));
        let sums = &mut sums[x * paths.count..(x + 1) * paths.count];
        sums.fill(0);
        paths.advance(0, from, (y, x), ends, sums);
    }
    for x in (0..paths.width).rev() {
        if paths.skips((y, x)) {
            continue;
        }
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
            if paths.skips((y, x)) {
                continue;
            }
            let from = (y > 0).then(|| ((y - 1, x), jumps[y * paths.width + x]));
            paths.advance(i, from, (y, x), ends, &mut row[i * count..(i + 1) * count]);
        }
    }
    for (y, (row, found)) in block.iter_mut().enumerate().rev() {
        for i in 0..columns {
            let x = first + i;
            if paths.skips((y, x)) {
                continue;
            }
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
        Candidates::All | Candidates::Own(_) => paths.grid.count,
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

/// Above the sum of a path, and far enough below `u16::MAX` that penalties can be added.
const INFINITE: u16 = 40_000;

/// Costs of all cells, and the penalties between them.
struct Paths<'a> {
    pub(crate) costs: &'a [u16],
    pub(crate) penalties: &'a Penalties,
    pub(crate) candidates: Candidates<'a>,
    pub(crate) grid: &'a Grid,
    /// Cells per row.
    pub(crate) width: usize,
    /// Candidates per cell.
    pub(crate) count: usize,
    /// If only a part of the cells is searched.
    known: Option<Known<'a>>,
}

/// Infinite values on each side of a path's L.
const MARGIN: usize = 2 * SEGMENT;

/// L of the last cell of several parallel paths.
struct PathEnds {
    /// L of each path's last cell, between infinite values.
    previous: Vec<u16>,
    next: Vec<u16>,
    /// The minimum of each path's L.
    minimum: Vec<u16>,
    /// L by index of the grid; infinite except while a step uses it.
    by_index: Vec<u16>,
}

impl PathEnds {
    /// Of that many parallel paths.
    pub(crate) fn new(paths: &Paths<'_>, number: usize) -> Self {
        let padded = paths.count + 2 * MARGIN;
        let indices = if let Candidates::All = paths.candidates { 0 } else { paths.grid.count + 2 * SEGMENT + 2 };
        Self {
            previous: vec![INFINITE; number * padded],
            next: vec![INFINITE; paths.count],
            minimum: vec![0; number],
            by_index: vec![INFINITE; indices],
        }
    }
}

impl Paths<'_> {
    /// Whether a cell is not searched.
    #[inline(always)]
    fn skips(&self, (y, x): (usize, usize)) -> bool {
        self.known.is_some_and(|(searched, _)| !searched[y * self.width + x])
    }

    /// Advances path number `path` to `cell` from the previous cell, with the penalty of a jump
    /// between them (`None`: the path begins here), and adds L to the cell's sums.
    #[inline(always)]
    pub(crate) fn advance(
        &self,
        path: usize,
        from: Option<((usize, usize), u16)>,
        cell: (usize, usize),
        ends: &mut PathEnds,
        sums: &mut [u16],
    ) {
        let count = self.count;
        let costs = &self.costs[(cell.0 * self.width + cell.1) * count..][..count];
        let previous = &mut ends.previous[path * (count + 2 * MARGIN)..][..count + 2 * MARGIN];
        let starts_of = |(y, x): (usize, usize)| match self.candidates {
            // As two segments that adjoin: together they are all candidates.
            Candidates::All | Candidates::Own(_) => [0, SEGMENT as u16],
            Candidates::Segments { starts, columns, cells_per_side } => {
                starts[y / cells_per_side * columns + x / cells_per_side]
            }
        };
        let new = starts_of(cell);
        // Candidates that the cell has.
        let used = if new[1] == Candidates::NO_SEGMENT { SEGMENT } else { count };
        let Some((from, jump)) = from.filter(|&(from, _)| !self.skips(from)) else {
            let known =
                from.zip(self.known).map(|((from, jump), (_, index))| (index[from.0 * self.width + from.1], jump));
            for k in 0..used {
                let apart = |index: f32| (self.candidates.index(cell, k) as f32 - index).abs();
                let penalty = match known.map(|(index, jump)| (apart(index), jump)) {
                    None | Some((..0.75, _)) => 0,
                    Some((..1.75, _)) => self.penalties.step,
                    Some((_, jump)) => jump,
                };
                previous[MARGIN + k] = costs[k] + penalty;
                sums[k] += previous[MARGIN + k];
            }
            previous[MARGIN + used..MARGIN + count].fill(INFINITE);
            sums[used..].fill(u16::MAX);
            ends.minimum[path] = minimum(&previous[MARGIN..MARGIN + used]);
            return;
        };
        let (best, step) = (ends.minimum[path], self.penalties.step);
        let jump = best + jump;
        let next = &mut ends.next;
        let old = starts_of(from);
        let joins = |[first, second]: [u16; 2]| second == Candidates::NO_SEGMENT || first + SEGMENT as u16 == second;
        let shift = isize::from(new[0].cast_signed()) - isize::from(old[0].cast_signed());
        if joins(old) && joins(new) && shift.unsigned_abs() < MARGIN {
            let first = MARGIN.wrapping_add_signed(shift) - 1;
            let (previous, costs) = (&previous[first..first + used + 2], &costs[..used]);
            path_costs(previous, costs, (best, step, jump), &mut next[..used], &mut sums[..used]);
        } else {
            // Index d is at d + 1.
            let by_index = &mut ends.by_index;
            let segments = |starts: [u16; 2]| {
                let present = starts.into_iter().filter(|&start| start != Candidates::NO_SEGMENT);
                present.map(usize::from).enumerate()
            };
            for (segment, start) in segments(old) {
                let values = &previous[MARGIN + segment * SEGMENT..][..SEGMENT];
                by_index[start + 1..][..SEGMENT].copy_from_slice(values);
            }
            for (segment, start) in segments(new) {
                let part = segment * SEGMENT..(segment + 1) * SEGMENT;
                let (next, sums) = (&mut next[part.clone()], &mut sums[part.clone()]);
                path_costs(&by_index[start..start + SEGMENT + 2], &costs[part], (best, step, jump), next, sums);
            }
            for (_, start) in segments(old) {
                by_index[start + 1..][..SEGMENT].fill(INFINITE);
            }
        }
        next[used..].fill(INFINITE);
        sums[used..].fill(u16::MAX);
        previous[MARGIN..MARGIN + count].copy_from_slice(next);
        ends.minimum[path] = minimum(next);
    }
}

/// Decides by the same paths which of its own candidates, fractional indices, each of some pixels has, which are
/// given in order; candidates and costs are those of all pixels. Of other pixels `index` is known. A step is one
/// of 0.75 to 1.75 indices, a smaller one is free.
#[pulp::with_simd(aggregate_own = liveview::simd::arch())]
#[inline(always)]
pub(crate) fn aggregate_own_with<'a, S: pulp::Simd>(
    _simd: S,
    pixels: &'a [usize],
    candidates: &'a [PerOwn],
    costs: &'a [[u16; OWN]],
    photo: &'a Planes,
    index: &'a mut [f32],
) {
    const NONE: f32 = INFINITE as f32;
    let (width, step) = (photo.width, (STEP_PENALTY * COST_SCALE).round());
    let mut slots = vec![u32::MAX; index.len()];
    pixels.iter().zip(0..).for_each(|(&at, slot)| slots[at] = slot);
    let mut sums = vec![[0.0_f32; OWN]; pixels.len()];
    let mut found = sums.clone();
    for path in 0..4 {
        for turn in 0..pixels.len() {
            let slot = if path % 2 == 0 { turn } else { pixels.len() - 1 - turn };
            let at = pixels[slot];
            let before = match path {
                0 => (!at.is_multiple_of(width)).then(|| at - 1),
                1 => (at % width + 1 < width).then_some(at + 1),
                2 => at.checked_sub(width),
                _ => Some(at + width).filter(|&before| before < index.len()),
            };
            let mut next = costs[at].map(f32::from);
            if let Some(before) = before {
                let (from, last) = match slots[before] {
                    u32::MAX => ([index[before]; OWN], [0.0, NONE, NONE]),
                    slot => (candidates[before], found[slot as usize]),
                };
                let least = last.iter().fold(NONE, |least, &cost| if cost < least { cost } else { least });
                let jump = jump_penalty(photo.difference(at, before));
                for k in 0..OWN {
                    let mut best = least + jump;
                    for j in 0..OWN {
                        let apart = (candidates[at][k] - from[j]).abs();
                        let penalty = if apart < 1.75 { step } else { NONE };
                        let cost = last[j] + if apart < 0.75 { 0.0 } else { penalty };
                        best = if cost < best { cost } else { best };
                    }
                    next[k] += best - least;
                }
            }
            (0..OWN).for_each(|k| sums[slot][k] += next[k]);
            found[slot] = next;
        }
    }
    for (&at, sums) in pixels.iter().zip(sums) {
        index[at] = candidates[at][(1..OWN).fold(0, |best, k| if sums[k] < sums[best] { k } else { best })];
    }
}

/// The smallest of the values, a vector at a time.
#[inline(always)]
fn minimum(values: &[u16]) -> u16 {
    let (chunks, rest) = values.as_chunks::<SEGMENT>();
    let mut minimum = [u16::MAX; SEGMENT];
    for values in chunks {
        (0..SEGMENT).for_each(|i| minimum[i] = minimum[i].min(values[i]));
    }
    minimum.iter().chain(rest).fold(u16::MAX, |minimum, &value| minimum.min(value))
}

/// L of consecutive candidates, added to their sums; `previous` has one more value on each side.
#[inline(always)]
fn path_costs(
    previous: &[u16],
    costs: &[u16],
    (best, step, jump): (u16, u16, u16),
    next: &mut [u16],
    sums: &mut [u16],
) {
    let count = costs.len();
    let (nearer, same, farther) = (&previous[..count], &previous[1..=count], &previous[2..count + 2]);
    for k in 0..count {
        let beside = nearer[k].min(farther[k]) + step;
        let cheapest = same[k].min(beside).min(jump);
        next[k] = costs[k] + (cheapest - best);
        sums[k] += next[k];
    }
}

/// P1: change to the next index.
pub(crate) const STEP_PENALTY: f32 = 0.01;
/// P2 where the photo has no edge: change to any other index.
pub(crate) const JUMP_PENALTY: f32 = 0.12;
/// Difference of colour (mean over the channels) that halves P2.
pub(crate) const EDGE_CONTRAST: f32 = 0.05;

/// Penalties in units of the cost volume.
pub(crate) struct Penalties {
    pub(crate) step: u16,
    /// Of a jump from the cell to the left, at each cell.
    jump_across: Vec<u16>,
    /// Of a jump from the cell above, at each cell.
    jump_down: Vec<u16>,
}

impl Penalties {
    pub(crate) fn new(photo: &Planes) -> Self {
        let (width, height) = (photo.width, photo.height);
        let step = (STEP_PENALTY * COST_SCALE).round();
        let jump = |difference: f32| jump_penalty(difference) as u16;
        let (mut across, mut down) = (vec![0; width * height], vec![0; width * height]);
        let rows = across.par_chunks_mut(width).zip(down.par_chunks_mut(width)).enumerate();
        rows.for_each(|(y, (across, down))| {
            let here: [&[f32]; 3] = std::array::from_fn(|c| photo.row(c, y));
            let above: [&[f32]; 3] = std::array::from_fn(|c| photo.row(c, y.saturating_sub(1)));
            for x in 0..width {
                let left = x.saturating_sub(1);
                let difference = |c: usize| ((here[c][x] - here[c][left]).abs(), (here[c][x] - above[c][x]).abs());
                let [r, g, b] = [difference(0), difference(1), difference(2)];
                (across[x], down[x]) = (jump((r.0 + g.0) + b.0), jump((r.1 + g.1) + b.1));
            }
        });
        Self { step: step as u16, jump_across: across, jump_down: down }
    }
}

/// P2 by the difference of colour, summed over the channels; a whole number.
#[inline(always)]
fn jump_penalty(difference: f32) -> f32 {
    let jump = JUMP_PENALTY / (1.0 + difference / 3.0 / EDGE_CONTRAST);
    // Rounded, halves away from 0: the sum is exact.
    (jump.max(1.01 * STEP_PENALTY) * COST_SCALE + 0.5).floor()
}

#[cfg(test)]
mod tests {
    use super::*;
    use liveview::image::ImageRgb;
    use liveview::warp::Texture;

    const WIDTH: usize = 21;
    const HEIGHT: usize = 7;
    /// Planes, all of them candidates of each cell.
    const COUNT: usize = 2 * SEGMENT;

    fn noise(at: usize, below: u32) -> u32 {
        ((at as u32).wrapping_mul(2_654_435_761) >> 8) % below
    }

    /// Costs along one path to each cell, by the recurrence of the module's documentation, in whole numbers.
    fn path(costs: &[u16], colour: &[f32], (dx, dy): (isize, isize)) -> Vec<i64> {
        let mut all = vec![0; costs.len()];
        let cells = 0..WIDTH * HEIGHT;
        let order: Vec<usize> = if dx + dy > 0 { cells.collect() } else { cells.rev().collect() };
        for at in order {
            let (x, y) = ((at % WIDTH).checked_add_signed(-dx), (at / WIDTH).checked_add_signed(-dy));
            let before = x.zip(y).filter(|&(x, y)| x < WIDTH && y < HEIGHT).map(|(x, y)| y * WIDTH + x);
            for d in 0..COUNT {
                let own = i64::from(costs[at * COUNT + d]);
                let Some(before) = before else {
                    all[at * COUNT + d] = own;
                    continue;
                };
                let previous = &all[before * COUNT..][..COUNT];
                let least = *previous.iter().min().unwrap();
                let contrast =
                    f64::from((0..3).map(|c| (colour[3 * at + c] - colour[3 * before + c]).abs()).sum::<f32>()) / 3.0;
                let [step, jump] =
                    [0.01, (0.12 / (1.0 + contrast / 0.05)).max(0.0101)].map(|p| (p * 32768.0_f64).round() as i64);
                let steps = [d.checked_sub(1), Some(d + 1).filter(|&d| d < COUNT)]
                    .into_iter()
                    .flatten()
                    .map(|d| previous[d] + step);
                all[at * COUNT + d] = own + steps.fold(previous[d].min(least + jump), i64::min) - least;
            }
        }
        all
    }

    #[test]
    fn aggregation_equals_its_recurrence() {
        let colour: Vec<f32> = (0..3 * WIDTH * HEIGHT)
            .map(|at| noise(at + 5, 64) as f32 / if at % 4 == 0 { 64.0 } else { 640.0 })
            .collect();
        let photo = Planes::new(&Texture::new(&ImageRgb::new(WIDTH, HEIGHT, colour.clone()).unwrap()));
        let costs: Vec<u16> = (0..WIDTH * HEIGHT * COUNT).map(|at| noise(at, 4900) as u16).collect();
        let grid = Grid::new(1.0, 4.0, COUNT - 3); // the last planes only fill the segment
        let found = aggregate(&costs, &photo, &grid, Candidates::All);
        let paths = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|towards| path(&costs, &colour, towards));
        let mut inner = 0;
        for (at, &found) in found.iter().enumerate() {
            let sums: Vec<i64> = (0..COUNT).map(|d| paths.iter().map(|path| path[at * COUNT + d]).sum()).collect();
            let k = (0..grid.count).min_by_key(|&d| sums[d]).unwrap();
            let mut expected = k as f32;
            if k > 0 && k + 1 < grid.count {
                let [a, b, c] = [sums[k - 1], sums[k], sums[k + 1]].map(|sum| sum as f32);
                expected += if a - 2.0 * b + c > 0.0 { (a - c) / (2.0 * (a - 2.0 * b + c)) } else { 0.0 };
                inner += 1;
            }
            assert!((found - expected).abs() < 1e-5, "{at}: {found}, not {expected}: {sums:?}");
        }
        assert!(inner > WIDTH * HEIGHT / 2, "{inner}");
    }
}
