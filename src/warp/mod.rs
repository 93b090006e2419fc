//! Warp: bilinear sampling of a view along a layer, straight into the batch that the network reads.
//!
//! A sample is valid iff w > 0 and its bilinear footprint touches the image; zeros outside (torch's
//! `grid_sample(mode="bilinear", padding_mode="zeros", align_corners=False)`). Coordinates that are not finite are
//! outside. Beside the colour each sample has its **coverage** in [0, 1]: the same sample of an all-ones image.

mod bilinear;
mod sample_positions;
mod texture;

use rayon::prelude::*;

use bilinear::sample;
use sample_positions::SamplePositions;
pub(crate) use sample_positions::{RUN, RunCoverage};
pub use texture::Texture;

use crate::geometry::{Camera, PlaneSweep, Size};

/// A view ready to be warped.
#[derive(Debug, Clone, Copy)]
pub struct SourceView<'a> {
    /// Its camera; for an image of the texture's size.
    pub camera: &'a Camera,
    /// Its photo.
    pub texture: &'a Texture,
}

/// One view as the warp sees it.
#[derive(Debug, Clone, Copy)]
pub struct WarpSource<'a> {
    /// Its photo.
    pub texture: &'a Texture,
    /// Its sweep over the target's disparities.
    pub sweep: PlaneSweep,
}

/// The views' textures and sweeps as seen from `target`.
pub fn warp_sources<'a>(views: &[SourceView<'a>], target: &Camera) -> Vec<WarpSource<'a>> {
    views.iter().map(|v| WarpSource { texture: v.texture, sweep: PlaneSweep::new(v.camera, target) }).collect()
}

/// Warp all views by n layers onto a target of that size (paper, section "HWV").
///
/// `disparity` is `[n, height, width]`, in 1/scene unit ([`crate::layers::Layer::fill`]). `colour` becomes
/// `[n, 3V, height, width]`: the homography warped volume; `coverage` becomes `[n, V, height, width]`.
///
/// # Panics
/// If the buffers have other sizes.
pub fn warp_layers(
    disparity: &[f32],
    sources: &[WarpSource<'_>],
    size: Size,
    colour: &mut [f32],
    coverage: &mut [f32],
) {
    let mut seen = vec![RunCoverage::Partly; disparity.len() / size.pixels() * sources.len() * seen_len(size)];
    warp_again(disparity, sources, size, colour, coverage, &mut seen);
}

/// Length of what is known of one view's coverage: one [`RunCoverage`] per run of [`RUN`] pixels of each row.
pub(crate) fn seen_len(Size { width, height }: Size) -> usize {
    height * width.div_ceil(RUN)
}

/// As [`warp_layers`] into buffers that have been used before: `seen`, `[n, V, seen_len]`, is what their coverage is known
/// to be (where it is 0 the colour is too), before and after. What would not change is not written: a warp that writes to
/// memory takes 1.5 times as long as one that stays in the cache.
pub(crate) fn warp_again(
    disparity: &[f32],
    sources: &[WarpSource<'_>],
    Size { width, height }: Size,
    colour: &mut [f32],
    coverage: &mut [f32],
    seen: &mut [RunCoverage],
) {
    let plane = height * width;
    assert_eq!(colour.len(), 3 * disparity.len() * sources.len(), "colour is [n, 3V, height, width]");
    assert_eq!(3 * coverage.len(), colour.len(), "coverage is [n, V, height, width]");
    let (band, runs) = (BAND * width, width.div_ceil(RUN));
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
    seen: &'a mut [RunCoverage],
) {
    let [red, green, blue, coverage] = out;
    let mut taps = SamplePositions::NONE;
    let mut spare = [[0.0; RUN]; 4];
    let mut padded = [0.0; RUN];
    for ((index, disparity), seen) in disparity.chunks(RUN).enumerate().zip(seen) {
        let run = index * RUN..index * RUN + disparity.len();
        let disparity = <&[f32; RUN]>::try_from(disparity).unwrap_or_else(|_| {
            padded = [disparity[0]; RUN];
            padded[..disparity.len()].copy_from_slice(disparity);
            &padded
        });
        let before = std::mem::replace(seen, taps.find(source, row, &run, disparity));
        match *seen {
            RunCoverage::None if before == RunCoverage::None => continue,
            RunCoverage::None => {
                [&mut *red, green, blue, coverage].into_iter().for_each(|plane| plane[run.clone()].fill(0.0));
                continue;
            }
            RunCoverage::All if before == RunCoverage::All => {}
            RunCoverage::All => coverage[run.clone()].fill(1.0),
            RunCoverage::Partly => {}
        }
        // Whole runs go straight to their planes; a row's end, and coverage that is known, to `spare`.
        let planes = [&mut *red, green, blue, coverage].map(|plane| &mut plane[run.clone()]);
        let planes = planes.into_iter().take(if *seen == RunCoverage::Partly { 4 } else { 3 });
        let mut channels = spare.each_mut();
        if run.len() == RUN {
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
    use crate::image::ImageRgb;

    /// A far layer, seen but for the left edge; a near one, seen in a corner; one beside the photo; and back.
    #[test]
    fn buffers_used_before_end_up_as_new_ones_do() {
        const SIZE: Size = Size::new(200, 40);
        let pixels = SIZE.pixels();
        let values = (0..3 * pixels).map(|i| (i % 251) as f32 / 250.0).collect();
        let texture = Texture::new(&ImageRgb::new(SIZE.width, SIZE.height, values).unwrap());
        let homography_at_infinity = DMat3::from_translation(glam::DVec2::new(-3.3, 0.2));
        let sweep = PlaneSweep { homography_at_infinity, epipole: DVec3::new(-150.0, 20.0, 0.0) };
        let sources = [WarpSource { texture: &texture, sweep }];
        let (mut colour, mut coverage) = (vec![9.0; 3 * pixels], vec![9.0; pixels]);
        let mut seen = vec![RunCoverage::Partly; seen_len(SIZE)];
        let mut met = [0; 3];
        for disparity in [0.0, 0.0, 1.0, 3.0, 3.0, 1.0, 0.0] {
            let disparity = vec![disparity; pixels];
            warp_again(&disparity, &sources, SIZE, &mut colour, &mut coverage, &mut seen);
            let (mut new_colour, mut new_coverage) = (vec![7.0; 3 * pixels], vec![7.0; pixels]);
            warp_layers(&disparity, &sources, SIZE, &mut new_colour, &mut new_coverage);
            assert!(colour == new_colour && coverage == new_coverage);
            let rows = coverage.chunks(SIZE.width).flat_map(|row| row.chunks(RUN));
            for (run, seen) in rows.zip(&seen) {
                met[*seen as usize] += 1;
                assert!(*seen != RunCoverage::All || run.iter().all(|&c| c == 1.0));
                assert!(*seen != RunCoverage::None || run.iter().all(|&c| c == 0.0));
            }
        }
        assert!(met.iter().all(|&runs| runs > 20), "{met:?}");
    }
}
