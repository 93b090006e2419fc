//! Depths that draw the cells of a second aggregation to them.
//!
//! A cell with an anchor of disparity d pays 0.05·min(|k − k(d)|/4, 1) more for index k, with k(d) the
//! (fractional) index of d; a cell without one pays half its costs, so that the paths from anchored
//! cells decide. The costs of a cell that is kept and has no anchor stay. In units of the volume
//! (1/32768), rounded to nearest; half a cost is rounded down.

use rayon::prelude::*;

use super::grid::Grid;
use super::photo_sweep::COST_SCALE;
use liveview::warp::round_to_i32;

/// Cost of an index far from the anchor.
const ANCHOR_COST: f32 = 0.05;
/// Distance from the anchor from which on that is paid, indices.
const ANCHOR_REACH: f32 = 4.0;

/// What is known of each cell of a search.
#[derive(Debug, Clone)]
pub(crate) struct Anchors {
    /// Whether the cell keeps the depth that it has.
    pub(crate) kept: Vec<bool>,
    /// Disparity that the cell is drawn to, 1/scene unit; −1 for none.
    pub(crate) disparity: Vec<f32>,
}

impl Anchors {
    /// Changes the costs `[h, w, n]` of a search over this grid.
    pub(crate) fn add_to(&self, costs: &mut [u16], grid: &Grid) {
        let count = costs.len() / self.kept.len();
        let cells = costs.par_chunks_mut(count).zip(&self.disparity).zip(&self.kept);
        cells.for_each(|((costs, &disparity), &kept)| {
            if disparity >= 0.0 {
                let anchor = grid.index(disparity);
                for (k, cost) in costs.iter_mut().enumerate() {
                    let share = ((k as f32 - anchor).abs() * (1.0 / ANCHOR_REACH)).min(1.0);
                    *cost += round_to_i32(ANCHOR_COST * COST_SCALE * share) as u16;
                }
            } else if !kept {
                costs.iter_mut().for_each(|cost| *cost /= 2);
            }
        });
    }
}
