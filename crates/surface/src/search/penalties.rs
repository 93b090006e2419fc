//! Penalties of semi-global aggregation for a change of index along a path: P1 and P2 of
//! [`super::aggregate`].

use rayon::prelude::*;

use super::photo_sweep::COST_SCALE;
use super::planes::Planes;

/// P1: change to the next index.
pub(crate) const STEP_PENALTY: f32 = 0.01;
/// P2 where the photo has no edge: change to any other index.
pub(crate) const JUMP_PENALTY: f32 = 0.12;
/// Difference of colour (mean over the channels) that halves P2.
pub(crate) const EDGE_CONTRAST: f32 = 0.05;

/// Penalties in units of the cost volume.
pub(super) struct Penalties {
    pub(super) step: u16,
    /// Of a jump from the cell to the left, at each cell.
    pub(super) jump_across: Vec<u16>,
    /// Of a jump from the cell above, at each cell.
    pub(super) jump_down: Vec<u16>,
}

impl Penalties {
    pub(super) fn new(photo: &Planes) -> Self {
        let (width, height) = (photo.width, photo.height);
        let step = (STEP_PENALTY * COST_SCALE).round();
        let jump = |difference: f32| {
            let jump = JUMP_PENALTY / (1.0 + difference / 3.0 / EDGE_CONTRAST);
            (jump.max(1.01 * STEP_PENALTY) * COST_SCALE).round() as u16
        };
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
