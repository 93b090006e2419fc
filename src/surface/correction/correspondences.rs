//! Pixels of two photos that show the same point, by what is known of the depth of both.

use crate::geometry::PlaneSweep;
use crate::surface::fusion::SurfaceView;
use crate::surface::fusion::project::project;

/// Rows and columns between the pixels that are looked at.
const STEP: usize = 8;
/// Within how many of the photo's pixels of parallax the two depths agree.
const AGREE: f32 = 2.0;

/// A pixel of a photo, and where another photo shows the same point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correspondence {
    /// Column and row of the pixel.
    pub(super) pixel: (usize, usize),
    /// Column and row in the other photo, px, the centre of the first at 0.5; inside it.
    pub(super) other: (f32, f32),
}

/// Of every eighth pixel of every eighth row, those whose confirmed depth, carried to the other photo, agrees within 2 px (the
/// photo's pixel of parallax) with the confirmed depth of the pixel it falls on.
pub(super) fn correspondences(view: &SurfaceView<'_>, other: &SurfaceView<'_>) -> Vec<Correspondence> {
    let sweep = PlaneSweep::new(other.view.camera, view.view.camera);
    let (rows, columns) = other.known.disparity.dim();
    let mut found = Vec::new();
    for (y, row) in view.known.disparity.outer_iter().enumerate().step_by(STEP) {
        for x in (0..row.len()).step_by(STEP).filter(|&x| row[x] >= 0.0) {
            let (at_x, at_y, disparity) = project(&sweep, (x, y), row[x]);
            if !(at_x >= 0.0 && at_y >= 0.0 && at_x < columns as f32 && at_y < rows as f32) {
                continue;
            }
            let own = other.known.disparity[(at_y as usize, at_x as usize)];
            if own >= 0.0 && (own - disparity).abs() < AGREE * view.known.pixel {
                found.push(Correspondence { pixel: (x, y), other: (at_x, at_y) });
            }
        }
    }
    found
}
