//! Warp: bilinear sampling of a view along a layer, straight into the batch that the network reads.
//!
//! A sample is valid iff w > 0 and its bilinear footprint touches the image; zeros outside (torch's
//! `grid_sample(mode="bilinear", padding_mode="zeros", align_corners=False)`). Coordinates that are not finite are
//! outside. Beside the colour each sample has its **coverage** in [0, 1]: the same sample of an all-ones image.

use glam::DVec3;
use rayon::prelude::*;

use crate::image_io::ImageRgb;
use crate::sweep::Sweep;

/// A view's photo made ready for sampling: RGB and a fourth channel of ones (whose sample is the coverage), inside a
/// border of zeros so that sampling needs no bounds test.
#[derive(Debug, Clone)]
pub struct Texture {
    texels: Vec<[f32; 4]>,
    width: usize,
    height: usize,
}

/// Zeros before the first and after the last pixel of a row or column: a coordinate clamped to one pixel outside the
/// image still has both its neighbours.
const BORDER: (usize, usize) = (1, 2);

impl Texture {
    /// Copies the photo.
    pub fn new(photo: &ImageRgb) -> Self {
        let (width, height) = (photo.width(), photo.height());
        let stride = width + BORDER.0 + BORDER.1;
        let mut texels = vec![[0.0; 4]; stride * (height + BORDER.0 + BORDER.1)];
        for (y, row) in photo.data().chunks_exact(3 * width).enumerate() {
            let at = (y + BORDER.0) * stride + BORDER.0;
            for (texel, rgb) in texels[at..at + width].iter_mut().zip(row.chunks_exact(3)) {
                *texel = [rgb[0], rgb[1], rgb[2], 1.0];
            }
        }
        Self { texels, width, height }
    }

    /// Columns of the photo.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the photo.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The photo with its fourth channel shrunk by `cell`: area average; cells at the border average the pixels they have.
    pub(crate) fn shrunk(&self, cell: usize) -> Self {
        let (width, height) = (self.width.div_ceil(cell), self.height.div_ceil(cell));
        let (stride, shrunk_stride) = (self.width + BORDER.0 + BORDER.1, width + BORDER.0 + BORDER.1);
        let mut texels = vec![[0.0; 4]; shrunk_stride * (height + BORDER.0 + BORDER.1)];
        let rows = texels.chunks_exact_mut(shrunk_stride).skip(BORDER.0).take(height);
        for (y, row) in rows.enumerate() {
            for (x, texel) in row[BORDER.0..BORDER.0 + width].iter_mut().enumerate() {
                let (last_y, last_x) = ((y * cell + cell).min(self.height), (x * cell + cell).min(self.width));
                let mut sum = [0.0; 4];
                for yy in y * cell..last_y {
                    let at = (yy + BORDER.0) * stride + BORDER.0;
                    for pixel in &self.texels[at + x * cell..at + last_x] {
                        (0..4).for_each(|c| sum[c] += pixel[c]);
                    }
                }
                *texel = sum.map(|s| s / sum[3]);
            }
        }
        Self { texels, width, height }
    }

    /// Bilinear sample between texel `at`, its right neighbour and the two below, at the given shares of the latter.
    #[inline(always)]
    fn sample(&self, at: usize, across: f32, down: f32) -> [f32; 4] {
        let stride = self.width + BORDER.0 + BORDER.1;
        let (upper, lower) = (&self.texels[at..at + 2], &self.texels[at + stride..at + stride + 2]);
        let weights = [(1.0 - across) * (1.0 - down), across * (1.0 - down), (1.0 - across) * down, across * down];
        std::array::from_fn(|c| {
            upper[0][c] * weights[0] + upper[1][c] * weights[1] + lower[0][c] * weights[2] + lower[1][c] * weights[3]
        })
    }
}

/// One view as the warp sees it.
#[derive(Debug, Clone, Copy)]
pub struct WarpSource<'a> {
    /// Its photo.
    pub texture: &'a Texture,
    /// Its sweep over the target's disparities.
    pub sweep: Sweep,
}

/// Warp all views by n layers onto a target of `width`×`height` pixels (paper, section "HWV").
///
/// `disparity` is `[n, height, width]`, in 1/scene unit ([`crate::layers::Layer::fill`]). `colour` becomes
/// `[n, 3V, height, width]`: the homography warped volume; `coverage` becomes `[n, V, height, width]`.
///
/// # Panics
/// If the buffers have other sizes.
pub fn warp_layers(
    disparity: &[f32],
    sources: &[WarpSource<'_>],
    (height, width): (usize, usize),
    colour: &mut [f32],
    coverage: &mut [f32],
) {
    let plane = height * width;
    assert_eq!(colour.len(), 3 * disparity.len() * sources.len(), "colour is [n, 3V, height, width]");
    assert_eq!(3 * coverage.len(), colour.len(), "coverage is [n, V, height, width]");
    let views = colour.par_chunks_mut(3 * plane).zip(coverage.par_chunks_mut(plane)).enumerate();
    views.for_each(|(index, (colour, coverage))| {
        let (layer, source) = (index / sources.len(), &sources[index % sources.len()]);
        let disparity = &disparity[layer * plane..(layer + 1) * plane];
        let (red, rest) = colour.split_at_mut(plane);
        let (green, blue) = rest.split_at_mut(plane);
        for row in 0..height {
            let span = row * width..(row + 1) * width;
            let out = [&mut red[span.clone()], &mut green[span.clone()], &mut blue[span.clone()]];
            warp_row(source, row, &disparity[span.clone()], out, &mut coverage[span]);
        }
    });
}

/// Pixels computed side by side.
const LANES: usize = 64;

/// One row of one view. Coordinates are f64 up to the sample: f32 rays were less exact than float32 torch's in the mean on
/// rectified rigs (1.4e-7 against 1.2e-7). First the coordinates of a run of pixels, then their samples: the first are
/// plain loops, compiled for the vector instructions that this machine has.
#[pulp::with_simd(warp_row = pulp::Arch::new())]
#[inline(always)]
fn warp_row_with<'a, S: pulp::Simd>(
    _simd: S,
    source: &'a WarpSource<'a>,
    row: usize,
    disparity: &'a [f32],
    rgb: [&'a mut [f32]; 3],
    coverage: &'a mut [f32],
) {
    let Sweep { homography_at_infinity: homography, epipole } = source.sweep;
    let begin = homography * DVec3::new(0.5, row as f64 + 0.5, 1.0);
    let (right, bottom) = ((source.texture.width + 1) as f64, (source.texture.height + 1) as f64);
    let stride = (source.texture.width + BORDER.0 + BORDER.1) as i32;
    let [red, green, blue] = rgb;
    let (mut texel, mut across, mut down) = ([0_i32; LANES], [0.0_f32; LANES], [0.0_f32; LANES]);
    for start in (0..disparity.len()).step_by(LANES) {
        let n = LANES.min(disparity.len() - start);
        let lanes = texel.iter_mut().zip(&mut across).zip(&mut down).zip(&disparity[start..start + n]);
        for (x, (((texel, across), down), &disparity)) in lanes.enumerate() {
            let (x, disparity) = ((start + x) as f64, f64::from(disparity));
            let uvw = begin + homography.x_axis * x + epipole * disparity;
            // +0.5: pixel centres lie at halves, the border adds one. NaN and w <= 0 end up at 0: outside.
            let per_w = if uvw.z > 0.0 { 1.0 / uvw.z } else { f64::NAN };
            let (at_x, at_y) = (within(uvw.x * per_w + 0.5, right), within(uvw.y * per_w + 0.5, bottom));
            let (column, row) = (at_x as i32, at_y as i32);
            (*across, *down) = ((at_x - f64::from(column)) as f32, (at_y - f64::from(row)) as f32);
            *texel = row * stride + column;
        }
        for i in 0..n {
            let at = start + i;
            [red[at], green[at], blue[at], coverage[at]] = source.texture.sample(texel[i] as usize, across[i], down[i]);
        }
    }
}

/// `x` brought into [0, last], NaN to 0: two instructions, where `f64::max` and `min` take eight.
#[inline(always)]
fn within(x: f64, last: f64) -> f64 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < last { x } else { last }
}
