//! Warp: bilinear sampling of a view along a layer, straight into the batch that the network reads.
//!
//! A sample is valid iff w > 0 and its bilinear footprint touches the image; zeros outside (torch's
//! `grid_sample(mode="bilinear", padding_mode="zeros", align_corners=False)`). Coordinates that are not finite are
//! outside. Beside the colour each sample has its **coverage** in [0, 1]: the same sample of an all-ones image.

use rayon::prelude::*;

use crate::image_io::ImageRgb;
use crate::sweep::Sweep;
use crate::taps::{LANES, Taps};

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

    /// Texels from one row to the next; as indices of texels, u32.
    pub(crate) fn stride(&self) -> u32 {
        (self.width + BORDER.0 + BORDER.1) as u32
    }

    /// Bilinear sample between texel `at`, its right neighbour and the two below, at the given shares of the latter.
    /// Neighbours lie side by side in memory: eight numbers at a time go down, four across.
    #[inline(always)]
    fn sample(&self, at: u32, across: f32, down: f32) -> [f32; 4] {
        // Widened from u32, sums cannot overflow, which saves half of the tests.
        let pair = |at: usize| self.texels[at..at + 2].as_flattened();
        let (upper, lower) = (pair(at as usize), pair(at as usize + self.stride() as usize));
        let (mut pair, mut mixed) = ([0.0; 8], [0.0; 4]);
        for i in 0..8 {
            pair[i] = upper[i] + (lower[i] - upper[i]) * down;
        }
        for i in 0..4 {
            mixed[i] = pair[i] + (pair[i + 4] - pair[i]) * across;
        }
        mixed
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
    let band = BAND * width;
    let views = colour.par_chunks_mut(3 * plane).zip(coverage.par_chunks_mut(plane)).enumerate();
    views.for_each(|(index, (colour, coverage))| {
        let (layer, source) = (index / sources.len(), &sources[index % sources.len()]);
        let disparity = &disparity[layer * plane..(layer + 1) * plane];
        let (red, rest) = colour.split_at_mut(plane);
        let (green, blue) = rest.split_at_mut(plane);
        let [red, green, blue, coverage] = [red, green, blue, coverage].map(|plane| plane.par_chunks_mut(band));
        let bands = disparity.par_chunks(band).zip(red).zip(green).zip(blue).zip(coverage).enumerate();
        bands.for_each(|(index, ((((disparity, red), green), blue), coverage))| {
            for (row, disparity) in disparity.chunks_exact(width).enumerate() {
                let span = row * width..(row + 1) * width;
                let out = [&mut *red, green, blue, coverage].map(|plane| &mut plane[span.clone()]);
                warp_row(source, index * BAND + row, disparity, out);
            }
        });
    });
}

/// Rows that one thread takes at a time: V views alone would not divide evenly among threads.
const BAND: usize = 32;

/// One row of one view, in plain loops over runs of pixels, compiled for the vector instructions that this machine has.
#[pulp::with_simd(warp_row = pulp::Arch::new())]
#[inline(always)]
fn warp_row_with<'a, S: pulp::Simd>(
    _simd: S,
    source: &'a WarpSource<'a>,
    row: usize,
    disparity: &'a [f32],
    out: [&'a mut [f32]; 4],
) {
    let [red, green, blue, coverage] = out;
    let mut taps = Taps::NONE;
    let mut samples = [[0.0; 4]; LANES];
    let width = disparity.len();
    let mut padded = [0.0; LANES];
    for start in (0..width).step_by(LANES) {
        // The last run overlaps the one before it, so that runs are short in short rows only.
        let run = start.min(width.saturating_sub(LANES))..(start + LANES).min(width);
        let disparity = <&[f32; LANES]>::try_from(&disparity[run.clone()]).unwrap_or_else(|_| {
            padded = [disparity[width - 1]; LANES];
            padded[..width].copy_from_slice(disparity);
            &padded
        });
        if !taps.find(source, row, &run, disparity) {
            [&mut *red, green, blue, coverage].into_iter().for_each(|plane| plane[run.clone()].fill(0.0));
            continue;
        }
        for (i, sample) in samples.iter_mut().enumerate() {
            *sample = source.texture.sample(taps.texel[i], taps.across[i], taps.down[i]);
        }
        for (channel, plane) in [&mut *red, green, blue, coverage].into_iter().enumerate() {
            plane[run.clone()].iter_mut().zip(&samples).for_each(|(value, sample)| *value = sample[channel]);
        }
    }
}
