//! What a path of the aggregation pays for a change of index: P1 and P2 of [`super::aggregate`].

use rayon::prelude::*;

use super::photo_sweep::UNIT;
use super::planes::Planes;

/// Penalties of a step to the next index and of a jump, and the difference of colour that halves the latter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Penalties {
    pub(crate) step: f32,
    pub(crate) jump: f32,
    pub(crate) edge: f32,
}

impl Default for Penalties {
    fn default() -> Self {
        Self { step: 0.01, jump: 0.12, edge: 0.05 }
    }
}

/// In units of the volume: the penalty of a step, and at each cell those of a jump from the cell to the left and from the one above.
pub(crate) struct Jumps {
    pub(crate) step: u16,
    pub(crate) across: Vec<u16>,
    pub(crate) down: Vec<u16>,
}

impl Jumps {
    pub(crate) fn new(photo: &Planes, penalties: &Penalties) -> Self {
        let (width, height) = (photo.width, photo.height);
        let step = (penalties.step * UNIT).round();
        let jump = |difference: f32| {
            let jump = penalties.jump / (1.0 + difference / 3.0 / penalties.edge);
            (jump.max(1.01 * penalties.step) * UNIT).round() as u16
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
        Self { step: step as u16, across, down }
    }
}
