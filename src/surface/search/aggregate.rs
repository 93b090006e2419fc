//! Semi-global aggregation of a photo's matching costs (Hirschmüller, 2008): four paths, whose penalty of a jump gives way at
//! the photo's edges.
//!
//! Along a path (right, left, down, up) the cost of index d at a cell is L(d) = C(d) + min(L'(d), L'(d − 1) + P1,
//! L'(d + 1) + P1, m + P2) − m with L' of the cell before and m its least; L = C at the first cell. P1 = 0.01,
//! P2 = max(0.12 / (1 + |ΔRGB| / 0.05), 1.01·P1), |ΔRGB| the mean over the channels of the difference of colour from the cell
//! before, both in units of the volume (1/32768), rounded to nearest (halves away from 0). L' of an index that the cell before is not
//! searched at is infinite (40,000). The sum over the four paths has its least at the cell's index (ties: the nearer; planes that only
//! fill the last segment beyond the grid's end take part in the paths and never win), which moves to the vertex of the parabola
//! through its sum and its neighbours' where both are among the candidates: by (a − c) / (2·(a − 2b + c)). Whole numbers (u16) but for
//! the parabola, in f32.

use rayon::prelude::*;

use super::grid::{Candidates, Grid, SEGMENT};
use super::penalties::{Jumps, Penalties};
use super::planes::Planes;

/// Above every sum of a path, and far enough below the end of u16 that penalties can be added.
const INFINITE: u16 = 40_000;
/// Columns that a thread takes down and up at a time.
const COLUMNS: usize = 16;

/// The index found at each cell, `[h, w]`, between two of the grid.
pub(crate) fn aggregate(
    costs: &[u16],
    photo: &Planes,
    grid: &Grid,
    candidates: Candidates<'_>,
    penalties: &Penalties,
) -> Vec<f32> {
    let (width, count) = (photo.width, candidates.count(grid));
    let jumps = Jumps::new(photo, penalties);
    let paths = Paths { costs, jumps: &jumps, candidates, grid, width, count };
    let mut sums = vec![0; costs.len()];
    let rows = sums.par_chunks_mut(width * count).enumerate();
    rows.for_each_init(|| Lanes::new(&paths, 1), |lanes, (y, sums)| across(&paths, y, lanes, sums));
    // Blocks of columns, each a list of its rows.
    let mut blocks: Vec<Vec<&mut [u16]>> = (0..width.div_ceil(COLUMNS)).map(|_| Vec::new()).collect();
    for row in sums.chunks_mut(width * count) {
        row.chunks_mut(COLUMNS * count).zip(&mut blocks).for_each(|(part, block)| block.push(part));
    }
    let columns = blocks.into_par_iter().enumerate().map_init(
        || Lanes::new(&paths, COLUMNS),
        |lanes, (index, mut block)| {
            let mut found = vec![0.0; photo.height * COLUMNS];
            down_and_up(&paths, index * COLUMNS, lanes, &mut block, &mut found);
            found
        },
    );
    let columns: Vec<_> = columns.collect();
    let mut found = Vec::with_capacity(width * photo.height);
    for y in 0..photo.height {
        for (index, block) in columns.iter().enumerate() {
            let wide = COLUMNS.min(width - index * COLUMNS);
            found.extend_from_slice(&block[y * COLUMNS..][..wide]);
        }
    }
    found
}

struct Paths<'a> {
    costs: &'a [u16],
    jumps: &'a Jumps,
    candidates: Candidates<'a>,
    grid: &'a Grid,
    width: usize,
    count: usize,
}

/// The paths' ends: L of the cells before and its least.
struct Lanes {
    /// Each cell's L between two that are infinite.
    before: Vec<u16>,
    next: Vec<u16>,
    least: Vec<u16>,
    /// L by index, infinite but while a cell is at work.
    by_index: Vec<u16>,
}

impl Lanes {
    fn new(paths: &Paths<'_>, cells: usize) -> Self {
        let room = paths.count + 2;
        let all = if let Candidates::All = paths.candidates { 0 } else { paths.grid.count() + 2 * SEGMENT + 2 };
        Self {
            before: vec![INFINITE; cells * room],
            next: vec![INFINITE; room],
            least: vec![0; cells],
            by_index: vec![INFINITE; all],
        }
    }
}

/// Right and left along row `y`; `sums` become those of both.
#[pulp::with_simd(across = crate::simd::arch())]
#[inline(always)]
fn across_with<'a, S: pulp::Simd>(_simd: S, paths: &'a Paths<'a>, y: usize, lanes: &'a mut Lanes, sums: &'a mut [u16]) {
    sums.fill(0);
    let jumps = &paths.jumps.across[y * paths.width..];
    for x in 0..paths.width {
        let from = (x > 0).then(|| ((y, x - 1), jumps[x]));
        paths.step(0, from, (y, x), lanes, &mut sums[x * paths.count..(x + 1) * paths.count]);
    }
    for x in (0..paths.width).rev() {
        let from = (x + 1 < paths.width).then(|| ((y, x + 1), jumps[x + 1]));
        paths.step(0, from, (y, x), lanes, &mut sums[x * paths.count..(x + 1) * paths.count]);
    }
}

/// Down and up the columns from `first` on, whose rows of sums `block` holds; `found` becomes their indices.
#[pulp::with_simd(down_and_up = crate::simd::arch())]
#[inline(always)]
fn down_and_up_with<'a, S: pulp::Simd>(
    _simd: S,
    paths: &'a Paths<'a>,
    first: usize,
    lanes: &'a mut Lanes,
    block: &'a mut [&mut [u16]],
    found: &'a mut [f32],
) {
    let (height, count) = (block.len(), paths.count);
    let wide = block[0].len() / count;
    for (y, row) in block.iter_mut().enumerate() {
        for i in 0..wide {
            let x = first + i;
            let from = (y > 0).then(|| ((y - 1, x), paths.jumps.down[y * paths.width + x]));
            paths.step(i, from, (y, x), lanes, &mut row[i * count..(i + 1) * count]);
        }
    }
    for (y, row) in block.iter_mut().enumerate().rev() {
        for i in 0..wide {
            let x = first + i;
            let from = (y + 1 < height).then(|| ((y + 1, x), paths.jumps.down[(y + 1) * paths.width + x]));
            let sums = &mut row[i * count..(i + 1) * count];
            paths.step(i, from, (y, x), lanes, sums);
            found[y * COLUMNS + i] = paths.winner((y, x), sums);
        }
    }
}

impl Paths<'_> {
    /// One step of a path in lane `lane`, from the cell before (none: the path begins) and its penalty of a jump; L is added to
    /// the sums of the cell.
    #[inline(always)]
    fn step(
        &self,
        lane: usize,
        from: Option<((usize, usize), u16)>,
        cell: (usize, usize),
        lanes: &mut Lanes,
        sums: &mut [u16],
    ) {
        let count = self.count;
        let costs = &self.costs[(cell.0 * self.width + cell.1) * count..][..count];
        let before = &mut lanes.before[lane * (count + 2)..][..count + 2];
        let pair = |(y, x): (usize, usize)| match self.candidates {
            Candidates::All => [0, 0],
            Candidates::Two { starts, columns, share } => starts[y / share * columns + x / share],
        };
        let new = pair(cell);
        // Candidates that the cell has.
        let used = if new[1] == Candidates::NONE { SEGMENT } else { count };
        let Some((from, jump)) = from else {
            before[1..=used].copy_from_slice(&costs[..used]);
            before[used + 1..=count].fill(INFINITE);
            sums[..used].iter_mut().zip(costs).for_each(|(sum, cost)| *sum += cost);
            sums[used..].fill(u16::MAX);
            lanes.least[lane] = least(&costs[..used]);
            return;
        };
        let (best, step) = (lanes.least[lane], self.jumps.step);
        let jump = best + jump;
        let next = &mut lanes.next;
        match self.candidates {
            Candidates::All => walk(before, costs, (best, step, jump), &mut next[1..=count], sums),
            Candidates::Two { .. } => {
                let old = pair(from);
                if old == new && (used == SEGMENT || old[0] + SEGMENT as u16 == old[1]) {
                    walk(
                        &before[..used + 2],
                        &costs[..used],
                        (best, step, jump),
                        &mut next[1..=used],
                        &mut sums[..used],
                    );
                } else {
                    // Index d stands at d + 1.
                    let all = &mut lanes.by_index;
                    let starts = |pair: [u16; 2]| {
                        pair.into_iter().filter(|&start| start != Candidates::NONE).map(usize::from).enumerate()
                    };
                    for (segment, start) in starts(old) {
                        let values = &before[1 + segment * SEGMENT..][..SEGMENT];
                        all[start + 1..][..SEGMENT].copy_from_slice(values);
                    }
                    for (segment, start) in starts(new) {
                        let part = segment * SEGMENT..(segment + 1) * SEGMENT;
                        let (next, sums) = (&mut next[1..][part.clone()], &mut sums[part.clone()]);
                        walk(&all[start..start + SEGMENT + 2], &costs[part], (best, step, jump), next, sums);
                    }
                    for (_, start) in starts(old) {
                        all[start + 1..][..SEGMENT].fill(INFINITE);
                    }
                }
                next[used + 1..=count].fill(INFINITE);
                sums[used..].fill(u16::MAX);
            }
        }
        before[1..=count].copy_from_slice(&next[1..=count]);
        lanes.least[lane] = least(&before[1..=count]);
    }

    /// The index of the least sum, between its neighbours.
    #[inline(always)]
    fn winner(&self, cell: (usize, usize), sums: &[u16]) -> f32 {
        let single = || sums[SEGMENT] == u16::MAX;
        let end = match self.candidates {
            Candidates::All => self.grid.count(),
            Candidates::Two { .. } => {
                if single() {
                    SEGMENT
                } else {
                    sums.len()
                }
            }
        };
        let least = least(&sums[..end]);
        let k = sums.iter().position(|&sum| sum == least).unwrap_or(0);
        let index = self.candidates.index(cell, k);
        let beside = |other: usize| self.candidates.index(cell, other).abs_diff(index) == 1;
        if k == 0 || k + 1 == end || !beside(k - 1) || !beside(k + 1) {
            return index as f32;
        }
        let [nearer, here, farther] = [sums[k - 1], sums[k], sums[k + 1]].map(f32::from);
        let curvature = nearer - 2.0 * here + farther;
        index as f32 + if curvature > 0.0 { 0.5 * (nearer - farther) / curvature } else { 0.0 }
    }
}

#[inline(always)]
fn least(values: &[u16]) -> u16 {
    let (lanes, rest) = values.as_chunks::<SEGMENT>();
    let mut least = [u16::MAX; SEGMENT];
    for values in lanes {
        (0..SEGMENT).for_each(|i| least[i] = least[i].min(values[i]));
    }
    least.iter().chain(rest).fold(u16::MAX, |least, &value| least.min(value))
}

/// L of consecutive candidates; `before` has one more on each side.
#[inline(always)]
fn walk(before: &[u16], costs: &[u16], (best, step, jump): (u16, u16, u16), next: &mut [u16], sums: &mut [u16]) {
    let count = costs.len();
    let (nearer, same, farther) = (&before[..count], &before[1..=count], &before[2..count + 2]);
    for k in 0..count {
        let beside = nearer[k].min(farther[k]) + step;
        let cheapest = same[k].min(beside).min(jump);
        next[k] = costs[k] + (cheapest - best);
        sums[k] += next[k];
    }
}
