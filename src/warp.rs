//! Warp: bilinear sampling of a view along a layer, straight into the batch that the network reads.
//!
//! A sample is valid iff w > 0 and its bilinear footprint touches the image; zeros outside (torch's
//! `grid_sample(mode="bilinear", padding_mode="zeros", align_corners=False)`). Coordinates that are not finite are
//! outside. Beside the colour each sample has its **coverage** in [0, 1]: the same sample of an all-ones image.

use rayon::prelude::*;

use crate::image_io::ImageRgb;
use crate::samples::sample;
use crate::sweep::Sweep;
use crate::taps::{LANES, Seen, Taps};

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

    /// All texels but the last row, and all but the first: a texel and the one below it have the same index in both, and one
    /// test of bounds serves both.
    #[inline(always)]
    pub(crate) fn upper_and_lower(&self) -> (&[[f32; 4]], &[[f32; 4]]) {
        let stride = self.stride() as usize;
        let lower = &self.texels[stride..];
        (&self.texels[..lower.len()], lower)
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
    size: (usize, usize),
    colour: &mut [f32],
    coverage: &mut [f32],
) {
    let mut seen = vec![Seen::Partly; disparity.len() / (size.0 * size.1) * sources.len() * seen_len(size)];
    warp_again(disparity, sources, size, colour, coverage, &mut seen);
}

/// Length of what is known of one view's coverage: one [`Seen`] per run of [`LANES`] pixels of each row.
pub(crate) fn seen_len((height, width): (usize, usize)) -> usize {
    height * width.div_ceil(LANES)
}

/// As [`warp_layers`] into buffers that have been used before: `seen`, `[n, V, seen_len]`, is what their coverage is known
/// to be (where it is 0 the colour is too), before and after. What would not change is not written: a warp that writes to
/// memory takes 1.5 times as long as one that stays in the cache.
pub(crate) fn warp_again(
    disparity: &[f32],
    sources: &[WarpSource<'_>],
    (height, width): (usize, usize),
    colour: &mut [f32],
    coverage: &mut [f32],
    seen: &mut [Seen],
) {
    let plane = height * width;
    assert_eq!(colour.len(), 3 * disparity.len() * sources.len(), "colour is [n, 3V, height, width]");
    assert_eq!(3 * coverage.len(), colour.len(), "coverage is [n, V, height, width]");
    let (band, runs) = (BAND * width, width.div_ceil(LANES));
    let planes = colour.chunks_mut(3 * plane).zip(coverage.chunks_mut(plane)).zip(seen.chunks_mut(height * runs));
    let mut views: Vec<_> = planes.enumerate().collect();
    // All layers of one view, then the next: its photo stays in the cache.
    views.sort_by_key(|(index, _)| index % sources.len());
    views.into_par_iter().for_each(|(index, ((colour, coverage), seen))| {
        let (layer, source) = (index / sources.len(), &sources[index % sources.len()]);
        let disparity = &disparity[layer * plane..(layer + 1) * plane];
        let (red, rest) = colour.split_at_mut(plane);
        let (green, blue) = rest.split_at_mut(plane);
        let [red, green, blue, coverage] = [red, green, blue, coverage].map(|plane| plane.par_chunks_mut(band));
        let bands = disparity.par_chunks(band).zip(red).zip(green).zip(blue).zip(coverage);
        let bands = bands.zip(seen.par_chunks_mut(BAND * runs)).enumerate();
        bands.for_each(|(index, (((((disparity, red), green), blue), coverage), seen))| {
            let rows = disparity.chunks_exact(width).zip(seen.chunks_exact_mut(runs));
            for (row, (disparity, seen)) in rows.enumerate() {
                let span = row * width..(row + 1) * width;
                let out = [&mut *red, green, blue, coverage].map(|plane| &mut plane[span.clone()]);
                warp_row(source, index * BAND + row, disparity, out, seen);
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
    simd: S,
    source: &'a WarpSource<'a>,
    row: usize,
    disparity: &'a [f32],
    out: [&'a mut [f32]; 4],
    seen: &'a mut [Seen],
) {
    let [red, green, blue, coverage] = out;
    let mut taps = Taps::NONE;
    let mut spare = [[0.0; LANES]; 4];
    let mut padded = [0.0; LANES];
    for ((index, disparity), seen) in disparity.chunks(LANES).enumerate().zip(seen) {
        let run = index * LANES..index * LANES + disparity.len();
        let disparity = <&[f32; LANES]>::try_from(disparity).unwrap_or_else(|_| {
            padded = [disparity[0]; LANES];
            padded[..disparity.len()].copy_from_slice(disparity);
            &padded
        });
        let before = std::mem::replace(seen, taps.find(source, row, &run, disparity));
        match *seen {
            Seen::None if before == Seen::None => continue,
            Seen::None => {
                [&mut *red, green, blue, coverage].into_iter().for_each(|plane| plane[run.clone()].fill(0.0));
                continue;
            }
            Seen::All if before == Seen::All => {}
            Seen::All => coverage[run.clone()].fill(1.0),
            Seen::Partly => {}
        }
        // Whole runs go straight to their planes; a row's end, and coverage that is known, to `spare`.
        let planes = [&mut *red, green, blue, coverage].map(|plane| &mut plane[run.clone()]);
        let planes = planes.into_iter().take(if *seen == Seen::Partly { 4 } else { 3 });
        let mut channels = spare.each_mut();
        if run.len() == LANES {
            channels
                .iter_mut()
                .zip(planes)
                .for_each(|(channel, plane)| *channel = plane.try_into().expect("a whole run"));
            sample(simd, source.texture, &taps, channels);
        } else {
            sample(simd, source.texture, &taps, channels);
            planes.zip(&spare).for_each(|(plane, spare)| plane.copy_from_slice(&spare[..run.len()]));
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    /// A far layer, seen but for the left edge; a near one, seen in a corner; one beside the photo; and back.
    #[test]
    fn buffers_used_before_end_up_as_new_ones_do() {
        const SIZE: (usize, usize) = (40, 200);
        let pixels = SIZE.0 * SIZE.1;
        let values = (0..3 * pixels).map(|i| (i % 251) as f32 / 250.0).collect();
        let texture = Texture::new(&ImageRgb::new(SIZE.1, SIZE.0, values).unwrap());
        let homography_at_infinity = DMat3::from_translation(glam::DVec2::new(-3.3, 0.2));
        let sweep = Sweep { homography_at_infinity, epipole: DVec3::new(-150.0, 20.0, 0.0) };
        let sources = [WarpSource { texture: &texture, sweep }];
        let (mut colour, mut coverage) = (vec![9.0; 3 * pixels], vec![9.0; pixels]);
        let mut seen = vec![Seen::Partly; seen_len(SIZE)];
        let mut met = [0; 3];
        for disparity in [0.0, 0.0, 1.0, 3.0, 3.0, 1.0, 0.0] {
            let disparity = vec![disparity; pixels];
            warp_again(&disparity, &sources, SIZE, &mut colour, &mut coverage, &mut seen);
            let (mut new_colour, mut new_coverage) = (vec![7.0; 3 * pixels], vec![7.0; pixels]);
            warp_layers(&disparity, &sources, SIZE, &mut new_colour, &mut new_coverage);
            assert!(colour == new_colour && coverage == new_coverage);
            let rows = coverage.chunks(SIZE.1).flat_map(|row| row.chunks(LANES));
            for (run, seen) in rows.zip(&seen) {
                met[*seen as usize] += 1;
                assert!(*seen != Seen::All || run.iter().all(|&c| c == 1.0));
                assert!(*seen != Seen::None || run.iter().all(|&c| c == 0.0));
            }
        }
        assert!(met.iter().all(|&runs| runs > 20), "{met:?}");
    }
}
