//! Pixels of two photos that show the same point, by the confirmed depth of both.

use crate::fusion::SurfaceView;
use crate::fusion::project::project;
use liveview::geometry::PlaneSweep;

/// Correspondences are sought at every eighth pixel of every eighth row.
const PIXEL_STEP: usize = 8;
/// Largest difference of the two depths, pixels of parallax of the first photo.
const AGREEMENT_PX: f32 = 2.0;

/// A pixel of a photo, and the position of the same point in another photo.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correspondence {
    /// Column and row of the pixel.
    pub(super) pixel: (usize, usize),
    /// Column and row in the other photo, pixels, the centre of the first at 0.5; inside it.
    pub(super) other: (f32, f32),
}

/// Of every eighth pixel of every eighth row, those whose confirmed depth, projected into the other
/// photo, agrees within 2 px (the photo's pixel of parallax) with the confirmed depth of the pixel
/// it falls on.
pub(super) fn correspondences(view: &SurfaceView<'_>, other: &SurfaceView<'_>) -> Vec<Correspondence> {
    let sweep = PlaneSweep::new(other.view.camera, view.view.camera);
    let (rows, columns) = other.confirmed.disparity.dim();
    let mut found = Vec::new();
    for (y, row) in view.confirmed.disparity.outer_iter().enumerate().step_by(PIXEL_STEP) {
        for x in (0..row.len()).step_by(PIXEL_STEP).filter(|&x| row[x] >= 0.0) {
            let (other_x, other_y, disparity) = project(&sweep, (x, y), row[x]);
            if !(other_x >= 0.0 && other_y >= 0.0 && other_x < columns as f32 && other_y < rows as f32) {
                continue;
            }
            let own = other.confirmed.disparity[(other_y as usize, other_x as usize)];
            if own >= 0.0 && (own - disparity).abs() < AGREEMENT_PX * view.confirmed.disparity_per_pixel {
                found.push(Correspondence { pixel: (x, y), other: (other_x, other_y) });
            }
        }
    }
    found
}
