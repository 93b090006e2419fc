//! Semi-global matching (Hirschmüller, 2008): matching costs aggregated along image rows and
//! columns, four paths.

use ndarray::{Array3, ArrayView3};

/// Penalties of a move along a path, in units of the cost: a variance of colours in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Penalties {
    /// Of a step to the next plane.
    pub step: f32,
    /// Of a jump to any other plane.
    pub jump: f32,
}

/// Sum over the four directions (down, up, right, left) of the cost of the cheapest path to each
/// cell, `[D, h, w]` → `[D, h, w]`.
pub fn semi_global(costs: ArrayView3<'_, f32>, penalties: Penalties) -> Array3<f32> {
    // The dimension that a path runs along comes first, that of parallel paths last, so that each
    // step is one pass over rows in memory.
    let down = costs.permuted_axes([1, 0, 2]).as_standard_layout().into_owned();
    let across = costs.permuted_axes([2, 0, 1]).as_standard_layout().into_owned();
    let both = |costs: &Array3<f32>| {
        let (mut there, back) = rayon::join(|| path(costs, penalties, false), || path(costs, penalties, true));
        there += &back;
        there
    };
    let (vertical, horizontal) = rayon::join(|| both(&down), || both(&across));
    vertical.permuted_axes([1, 0, 2]).as_standard_layout().into_owned() + horizontal.permuted_axes([1, 2, 0])
}

/// The paths of one direction through `costs` `[steps, D, lanes]`: the cost of the cell, plus the
/// least of staying on the plane, stepping to the next one and jumping to any other, less the least
/// cost of the step before (which keeps the sums small and changes no comparison).
fn path(costs: &Array3<f32>, penalties: Penalties, backwards: bool) -> Array3<f32> {
    let (steps, planes, lanes) = costs.dim();
    let size = planes * lanes;
    let mut total = costs.clone();
    let all = total.as_slice_mut().expect("standard order");
    let mut best = vec![0.0; lanes];
    for step in 1..steps {
        let (before, here) = if backwards {
            let (here, before) = all.split_at_mut((steps - step) * size);
            (&before[..size], &mut here[(steps - step - 1) * size..])
        } else {
            let (before, here) = all.split_at_mut(step * size);
            (&before[(step - 1) * size..], &mut here[..size])
        };
        advance(before, here, &mut best, penalties);
    }
    total
}

/// One step of parallel paths: `here` `[D, lanes]` are the costs of the cells and become those of the
/// paths; `best` is a row to work in.
#[pulp::with_simd(advance = liveview::simd::arch())]
#[inline(always)]
fn advance_with<'a, S: pulp::Simd>(
    _simd: S,
    before: &'a [f32],
    here: &'a mut [f32],
    best: &'a mut [f32],
    penalties: Penalties,
) {
    let lanes = best.len();
    let planes = before.len() / lanes;
    best.copy_from_slice(&before[..lanes]);
    for row in before.chunks_exact(lanes) {
        best.iter_mut().zip(row).for_each(|(best, &cost)| *best = if cost < *best { cost } else { *best });
    }
    for (plane, here) in here.chunks_exact_mut(lanes).enumerate() {
        let row = |plane: usize| &before[plane * lanes..(plane + 1) * lanes];
        let (nearer, same, farther) = (row(plane.saturating_sub(1)), row(plane), row((plane + 1).min(planes - 1)));
        let beside = here.iter_mut().zip(nearer).zip(farther).zip(same).zip(&*best);
        for ((((here, &nearer), &farther), &same), &best) in beside {
            // At the first and the last plane one of the two is the plane itself, whose cost
            // plus the penalty is never the least.
            let step = if nearer < farther { nearer } else { farther } + penalties.step;
            let stay = if same < step { same } else { step };
            let jump = best + penalties.jump;
            *here += (if stay < jump { stay } else { jump }) - best;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PENALTIES: Penalties = Penalties { step: 0.004, jump: 0.1 };

    #[test]
    fn ambiguous_cell_takes_the_plane_of_its_neighbours() {
        let mut costs = Array3::from_elem((3, 1, 5), 0.05);
        (0..5).filter(|&x| x != 2).for_each(|x| costs[(1, 0, x)] = 0.0);
        let aggregated = semi_global(costs.view(), PENALTIES);
        let [nearer, here, farther] = [0, 1, 2].map(|plane| aggregated[(plane, 0, 2)]);
        assert!(here < nearer && here < farther, "{aggregated}");
    }

    #[test]
    fn single_plane_adds_up_its_costs() {
        let costs = Array3::from_shape_fn((1, 2, 2), |(_, y, x)| (y + x) as f32);
        assert_eq!(semi_global(costs.view(), PENALTIES), 4.0 * costs);
    }
}
