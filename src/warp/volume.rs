//! The homography warped volume: all views sampled along all layers of a batch.

use rayon::prelude::*;

use super::bilinear::sample;
use super::sample_positions::{RUN, RunCoverage, SamplePositions};
use super::source::{NO_GAINS, WarpSource};
use crate::geometry::Size;

/// Warps all views along n layers onto a target of that size (paper, section "HWV").
///
/// `disparity` is `[n, height, width]`, in 1/scene unit ([`crate::layers::Layer::fill`]). `colour` becomes `[n, 3V, height, width]`:
/// the homography warped volume, RGB in [0, 1]; `coverage` becomes `[n, V, height, width]`.
///
/// # Panics
///
/// If the buffers have other sizes, or a side of `size` is 0.
pub fn warp_layers(
    disparity: &[f32],
    sources: &[WarpSource<'_>],
    size: Size,
    colour: &mut [f32],
    coverage: &mut [f32],
) {
    let runs = disparity.len() / size.pixels() * sources.len() * run_coverage_len(size);
    warp_layers_again(disparity, sources, size, colour, coverage, &mut vec![RunCoverage::Partly; runs]);
}

/// Number of [`RunCoverage`]s of one view on one layer: one per run of [`RUN`] pixels of each row.
pub(crate) fn run_coverage_len(Size { width, height }: Size) -> usize {
    height * width.div_ceil(RUN)
}

/// As [`warp_layers`], into buffers that hold an earlier warp. `run_coverage` `[n, V, run_coverage_len]` is what is known about the
/// coverage that they hold (where that is 0 the colour is too), before the call and after it. Values that would not change are not
/// written: memory, not arithmetic, limits the warp (docs/experiments.md).
pub(crate) fn warp_layers_again(
    disparity: &[f32],
    sources: &[WarpSource<'_>],
    Size { width, height }: Size,
    colour: &mut [f32],
    coverage: &mut [f32],
    run_coverage: &mut [RunCoverage],
) {
    let plane = height * width;
    assert_eq!(colour.len(), 3 * disparity.len() * sources.len(), "colour is [n, 3V, height, width]");
    assert_eq!(3 * coverage.len(), colour.len(), "coverage is [n, V, height, width]");
    let (band, runs) = (BAND * width, width.div_ceil(RUN));
    let planes =
        colour.chunks_mut(3 * plane).zip(coverage.chunks_mut(plane)).zip(run_coverage.chunks_mut(height * runs));
    let mut views: Vec<_> = planes.enumerate().collect();
    // All layers of one view, then the next: its photo stays in the cache.
    views.sort_by_key(|(index, _)| index % sources.len());
    views.into_par_iter().for_each(|(index, ((colour, coverage), run_coverage))| {
        let (layer, source) = (index / sources.len(), &sources[index % sources.len()]);
        let disparity = &disparity[layer * plane..(layer + 1) * plane];
        let (red, rest) = colour.split_at_mut(plane);
        let (green, blue) = rest.split_at_mut(plane);
        let [red, green, blue, coverage] = [red, green, blue, coverage].map(|plane| plane.par_chunks_mut(band));
        let bands = disparity.par_chunks(band).zip(red).zip(green).zip(blue).zip(coverage);
        let bands = bands.zip(run_coverage.par_chunks_mut(BAND * runs)).enumerate();
        bands.for_each(|(index, (((((disparity, red), green), blue), coverage), run_coverage))| {
            let rows = disparity.chunks_exact(width).zip(run_coverage.chunks_exact_mut(runs));
            for (row, (disparity, run_coverage)) in rows.enumerate() {
                let span = row * width..(row + 1) * width;
                let out = [&mut *red, green, blue, coverage].map(|plane| &mut plane[span.clone()]);
                warp_row(source, index * BAND + row, disparity, out, run_coverage);
            }
        });
    });
}

/// Rows that one task takes: V views alone would not divide evenly among threads.
const BAND: usize = 32;

/// Warps one row of one view: plain loops over runs of pixels, compiled for the vector instructions of this processor.
#[pulp::with_simd(warp_row = pulp::Arch::new())]
#[inline(always)]
fn warp_row_with<'a, S: pulp::Simd>(
    simd: S,
    source: &'a WarpSource<'a>,
    row: usize,
    disparity: &'a [f32],
    out: [&'a mut [f32]; 4],
    run_coverage: &'a mut [RunCoverage],
) {
    let [red, green, blue, coverage] = out;
    let mut positions = SamplePositions::NONE;
    let mut spare = [[0.0; RUN]; 4];
    let mut padded = [0.0; RUN];
    for ((index, disparity), run_coverage) in disparity.chunks(RUN).enumerate().zip(run_coverage) {
        let run = index * RUN..index * RUN + disparity.len();
        let disparity = <&[f32; RUN]>::try_from(disparity).unwrap_or_else(|_| {
            padded = [disparity[0]; RUN];
            padded[..disparity.len()].copy_from_slice(disparity);
            &padded
        });
        let before = std::mem::replace(run_coverage, positions.find(source, row, &run, disparity));
        match *run_coverage {
            RunCoverage::None if before == RunCoverage::None => continue,
            RunCoverage::None => {
                [&mut *red, green, blue, coverage].into_iter().for_each(|plane| plane[run.clone()].fill(0.0));
                continue;
            }
            RunCoverage::All if before == RunCoverage::All => {}
            RunCoverage::All => coverage[run.clone()].fill(1.0),
            RunCoverage::Partly => {}
        }
        // Whole runs are written to their planes; a row's end, and coverage that is known, to `spare`.
        let planes = [&mut *red, green, blue, coverage].map(|plane| &mut plane[run.clone()]);
        let planes = planes.into_iter().take(if *run_coverage == RunCoverage::Partly { 4 } else { 3 });
        let mut channels = spare.each_mut();
        if run.len() == RUN {
            channels
                .iter_mut()
                .zip(planes)
                .for_each(|(channel, plane)| *channel = plane.try_into().expect("a whole run"));
            sample(simd, source.texture, &positions, channels.each_mut().map(|channel| &mut **channel));
            multiply(&mut channels, source.gains);
        } else {
            sample(simd, source.texture, &positions, spare.each_mut());
            multiply(&mut spare.each_mut(), source.gains);
            planes.zip(&spare).for_each(|(plane, spare)| plane.copy_from_slice(&spare[..run.len()]));
        }
    }
}

/// The colours of a run, multiplied by the gains of their photo.
#[inline(always)]
fn multiply(channels: &mut [&mut [f32; RUN]; 4], gains: [f32; 3]) {
    if gains != NO_GAINS {
        for (channel, gain) in channels.iter_mut().zip(gains) {
            channel.iter_mut().for_each(|value| *value *= gain);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::geometry::PlaneSweep;
    use crate::image::ImageRgb;
    use crate::warp::Texture;

    /// A far layer, seen but for the left edge; a near one, seen in a corner; one beside the photo; and back.
    #[test]
    fn buffers_used_before_end_up_as_new_ones_do() {
        const SIZE: Size = Size::new(200, 40);
        let pixels = SIZE.pixels();
        let values = (0..3 * pixels).map(|i| (i % 251) as f32 / 250.0).collect();
        let texture = Texture::new(&ImageRgb::new(SIZE.width, SIZE.height, values).unwrap());
        let homography_at_infinity = DMat3::from_translation(glam::DVec2::new(-3.3, 0.2));
        let sweep = PlaneSweep { homography_at_infinity, epipole: DVec3::new(-150.0, 20.0, 0.0) };
        let sources = [WarpSource::new(&texture, sweep)];
        let (mut colour, mut coverage) = (vec![9.0; 3 * pixels], vec![9.0; pixels]);
        let mut run_coverage = vec![RunCoverage::Partly; run_coverage_len(SIZE)];
        let mut met = [0; 3];
        for disparity in [0.0, 0.0, 1.0, 3.0, 3.0, 1.0, 0.0] {
            let disparity = vec![disparity; pixels];
            warp_layers_again(&disparity, &sources, SIZE, &mut colour, &mut coverage, &mut run_coverage);
            let (mut new_colour, mut new_coverage) = (vec![7.0; 3 * pixels], vec![7.0; pixels]);
            warp_layers(&disparity, &sources, SIZE, &mut new_colour, &mut new_coverage);
            assert!(colour == new_colour && coverage == new_coverage);
            let rows = coverage.chunks(SIZE.width).flat_map(|row| row.chunks(RUN));
            for (run, run_coverage) in rows.zip(&run_coverage) {
                met[*run_coverage as usize] += 1;
                assert!(*run_coverage != RunCoverage::All || run.iter().all(|&c| c == 1.0));
                assert!(*run_coverage != RunCoverage::None || run.iter().all(|&c| c == 0.0));
            }
        }
        assert!(met.iter().all(|&runs| runs > 20), "{met:?}");
    }
}
