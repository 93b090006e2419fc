//! One step of a path of semi-global aggregation: the recursion of [`super::aggregate`].

use super::grid::{Candidates, Grid, SEGMENT};
use super::penalties::Penalties;

/// Above the sum of a path, and far enough below `u16::MAX` that penalties can be added.
const INFINITE: u16 = 40_000;

/// Costs of all cells, and the penalties between them.
pub(super) struct Paths<'a> {
    pub(super) costs: &'a [u16],
    pub(super) penalties: &'a Penalties,
    pub(super) candidates: Candidates<'a>,
    pub(super) grid: &'a Grid,
    /// Cells per row.
    pub(super) width: usize,
    /// Candidates per cell.
    pub(super) count: usize,
}

/// L of the last cell of several parallel paths.
pub(super) struct PathEnds {
    /// L of each path's last cell, between two infinite values.
    previous: Vec<u16>,
    next: Vec<u16>,
    /// The minimum of each path's L.
    minimum: Vec<u16>,
    /// L by index of the grid; infinite except while a step uses it.
    by_index: Vec<u16>,
}

impl PathEnds {
    /// Of that many parallel paths.
    pub(super) fn new(paths: &Paths<'_>, number: usize) -> Self {
        let padded = paths.count + 2;
        let indices = if let Candidates::All = paths.candidates { 0 } else { paths.grid.count + 2 * SEGMENT + 2 };
        Self {
            previous: vec![INFINITE; number * padded],
            next: vec![INFINITE; padded],
            minimum: vec![0; number],
            by_index: vec![INFINITE; indices],
        }
    }
}

impl Paths<'_> {
    /// Advances path number `path` to `cell` from the previous cell, with the penalty of a jump
    /// between them (`None`: the path begins here), and adds L to the cell's sums.
    #[inline(always)]
    pub(super) fn advance(
        &self,
        path: usize,
        from: Option<((usize, usize), u16)>,
        cell: (usize, usize),
        ends: &mut PathEnds,
        sums: &mut [u16],
    ) {
        let count = self.count;
        let costs = &self.costs[(cell.0 * self.width + cell.1) * count..][..count];
        let previous = &mut ends.previous[path * (count + 2)..][..count + 2];
        let starts_of = |(y, x): (usize, usize)| match self.candidates {
            // As two segments that adjoin: together they are all candidates.
            Candidates::All => [0, SEGMENT as u16],
            Candidates::Segments { starts, columns, cells_per_side } => {
                starts[y / cells_per_side * columns + x / cells_per_side]
            }
        };
        let new = starts_of(cell);
        // Candidates that the cell has.
        let used = if new[1] == Candidates::NO_SEGMENT { SEGMENT } else { count };
        let Some((from, jump)) = from else {
            previous[1..=used].copy_from_slice(&costs[..used]);
            previous[used + 1..=count].fill(INFINITE);
            sums[..used].iter_mut().zip(costs).for_each(|(sum, cost)| *sum += cost);
            sums[used..].fill(u16::MAX);
            ends.minimum[path] = minimum(&costs[..used]);
            return;
        };
        let (best, step) = (ends.minimum[path], self.penalties.step);
        let jump = best + jump;
        let next = &mut ends.next;
        let old = starts_of(from);
        if old == new && (used == SEGMENT || old[0] + SEGMENT as u16 == old[1]) {
            let (previous, costs) = (&previous[..used + 2], &costs[..used]);
            path_costs(previous, costs, (best, step, jump), &mut next[1..=used], &mut sums[..used]);
        } else {
            // Index d is at d + 1.
            let by_index = &mut ends.by_index;
            let segments = |starts: [u16; 2]| {
                let present = starts.into_iter().filter(|&start| start != Candidates::NO_SEGMENT);
                present.map(usize::from).enumerate()
            };
            for (segment, start) in segments(old) {
                let values = &previous[1 + segment * SEGMENT..][..SEGMENT];
                by_index[start + 1..][..SEGMENT].copy_from_slice(values);
            }
            for (segment, start) in segments(new) {
                let part = segment * SEGMENT..(segment + 1) * SEGMENT;
                let (next, sums) = (&mut next[1..][part.clone()], &mut sums[part.clone()]);
                path_costs(&by_index[start..start + SEGMENT + 2], &costs[part], (best, step, jump), next, sums);
            }
            for (_, start) in segments(old) {
                by_index[start + 1..][..SEGMENT].fill(INFINITE);
            }
        }
        next[used + 1..=count].fill(INFINITE);
        sums[used..].fill(u16::MAX);
        previous[1..=count].copy_from_slice(&next[1..=count]);
        ends.minimum[path] = minimum(&previous[1..=count]);
    }
}

/// The smallest of the values, a vector at a time.
#[inline(always)]
pub(super) fn minimum(values: &[u16]) -> u16 {
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
