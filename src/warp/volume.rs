//! The homography warped volume: all views sampled along all layers of a batch.

use rayon::prelude::*;

use super::WarpSource;
use super::layer_band::{LayerBand, OwnDisparity};
use super::run::{RUN, Run, RunCoverage};
use super::sample_positions::SamplePositions;
use crate::geometry::Size;

/// Warps all views along n layers onto a target of that size (paper, section "HWV").
///
/// `disparity` is `[n, height, width]`, in 1/scene unit ([`crate::layers::Layer::fill`]). `colour`
/// becomes `[n, 3V, height, width]`: the homography warped volume, RGB in [0, 1]; `coverage`
/// becomes `[n, V, height, width]`.
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
    let (mut run_coverage, mut seen) = (vec![RunCoverage::Partial; runs], vec![0; runs]);
    let (run_coverage, seen) = (run_coverage.as_mut_slice(), seen.as_mut_slice());
    warp_layers_into(sources, &[], size, &mut WarpedLayers { disparity, colour, coverage, run_coverage, seen });
}

/// Number of [`RunCoverage`]s of one view on one layer: one per run of [`RUN`] pixels of each row.
pub(crate) fn run_coverage_len(Size { width, height }: Size) -> usize {
    height * width.div_ceil(RUN)
}

/// Layers that views are warped by, and the output of the warp.
#[derive(Debug)]
pub(crate) struct WarpedLayers<'a> {
    /// `[n, h, w]`, 1/scene unit.
    pub(crate) disparity: &'a [f32],
    /// `[n, 3V, h, w]`.
    pub(crate) colour: &'a mut [f32],
    /// `[n, V, h, w]`.
    pub(crate) coverage: &'a mut [f32],
    /// What is known of the coverage, `[n, V, run_coverage_len]`.
    pub(crate) run_coverage: &'a mut [RunCoverage],
    /// Which pixels of each run the view sees by its own depth, by bit; as many.
    pub(crate) seen: &'a mut [u64],
}

impl WarpedLayers<'_> {
    /// Passes each view of each layer, in the order of the buffers, to `take` in bands of `rows` rows
    /// (the last may have fewer), with the index of the view and that of the band.
    pub(crate) fn for_each_band<'a>(
        &'a mut self,
        views: usize,
        size: Size,
        rows: usize,
        mut take: impl FnMut(usize, usize, LayerBand<'a>),
    ) {
        let (plane, band) = (size.pixels(), rows * size.width);
        let (plane_runs, band_runs) = (run_coverage_len(size), rows * size.width.div_ceil(RUN));
        let planes = self.colour.chunks_mut(3 * plane).zip(self.coverage.chunks_mut(plane));
        let runs = self.run_coverage.chunks_mut(plane_runs).zip(self.seen.chunks_mut(plane_runs));
        for (index, ((colour, coverage), (run_coverage, seen))) in planes.zip(runs).enumerate() {
            let disparity = self.disparity[index / views * plane..][..plane].chunks(band);
            let (red, rest) = colour.split_at_mut(plane);
            let (green, blue) = rest.split_at_mut(plane);
            let mut planes = [red, green, blue, coverage].map(|plane| plane.chunks_mut(band));
            let runs = run_coverage.chunks_mut(band_runs).zip(seen.chunks_mut(band_runs));
            for (index_of_band, (disparity, (run_coverage, seen))) in disparity.zip(runs).enumerate() {
                let planes = planes.each_mut().map(|bands| bands.next().expect("as many bands"));
                take(index % views, index_of_band, LayerBand { disparity, planes, run_coverage, seen });
            }
        }
    }
}

/// As [`warp_layers`], into buffers that hold an earlier warp. `run_coverage` is what is known
/// about the coverage in them (where that is 0 the colour is too), before the call and after it.
/// Values that would not change are not written: memory, not arithmetic, limits the warp
/// (docs/design-log/speed.md). `own` is the own depth of each view; without any, `seen` stays
/// unchanged.
pub(crate) fn warp_layers_into(
    sources: &[WarpSource<'_>],
    own: &[OwnDisparity<'_>],
    size: Size,
    layers: &mut WarpedLayers<'_>,
) {
    let values = layers.disparity.len() * sources.len();
    assert_eq!(layers.colour.len(), 3 * values, "colour is [n, 3V, height, width]");
    assert_eq!(layers.coverage.len(), values, "coverage is [n, V, height, width]");
    // Band by band of one view, then of the next: its photo stays in the cache. All layers of a
    // band together, as a run may be the same on the next layer.
    let bands = size.height.div_ceil(BAND_ROWS);
    let mut tasks: Vec<Vec<LayerBand<'_>>> = (0..sources.len() * bands).map(|_| Vec::new()).collect();
    layers.for_each_band(sources.len(), size, BAND_ROWS, |view, band, layer| tasks[view * bands + band].push(layer));
    tasks.into_par_iter().enumerate().for_each(|(index, mut layers)| {
        let (view, first) = (index / bands, index % bands * BAND_ROWS);
        warp_band(&sources[view], own.get(view), first, size.width, &mut layers);
    });
}

/// Rows of a task: V views alone would not divide evenly among threads.
const BAND_ROWS: usize = 32;

/// Warps a band of one view, from row `first` on: plain loops over runs of pixels, compiled for the
/// vector instructions of this processor.
#[pulp::with_simd(warp_band = crate::simd::wide_arch())]
#[inline(always)]
fn warp_band_with<'a, 'b, S: pulp::Simd>(
    simd: S,
    source: &'a WarpSource<'a>,
    own: Option<&'a OwnDisparity<'a>>,
    first: usize,
    width: usize,
    layers: &'a mut [LayerBand<'b>],
) {
    let mut positions = SamplePositions::NEW;
    let (mut padded, mut scratch) = ([0.0; RUN], [[0.0; RUN]; 4]);
    let rows = layers.first().map_or(0, |layer| layer.disparity.len() / width);
    for (row, start) in (0..rows).flat_map(|row| (0..width).step_by(RUN).map(move |start| (row, start))) {
        let run = start..(start + RUN).min(width);
        let at = Run { index: row * width.div_ceil(RUN) + start / RUN, first: row * width + start, len: run.len() };
        for layer in 0..layers.len() {
            let (previous, layer) = layers.split_at_mut(layer);
            let layer = &mut layer[0];
            if previous.last().is_some_and(|previous| layer.copy_if_same(previous, &at)) {
                continue;
            }
            let disparity = &layer.disparity[at.span()];
            let disparity = <&[f32; RUN]>::try_from(disparity).unwrap_or_else(|_| {
                padded = [disparity[0]; RUN];
                padded[..disparity.len()].copy_from_slice(disparity);
                &padded
            });
            let coverage = if let Some(own) = own {
                let coverage = positions.locate::<true>(source, first + row, &run, disparity);
                layer.seen[at.index] = own.seen(&positions) | !at.bits();
                coverage
            } else {
                positions.locate::<false>(source, first + row, &run, disparity)
            };
            if layer.set_coverage(&at, coverage) {
                layer.sample(simd, source, &positions, &at, &mut scratch);
            }
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

    /// A far layer, covered except at the left edge; a near one, covered in a corner; one outside
    /// the photo; and back.
    #[test]
    fn warp_layers_into_used_buffers_equals_new_ones() {
        const SIZE: Size = Size::new(200, 40);
        let pixels = SIZE.pixels();
        let values = (0..3 * pixels).map(|i| (i % 251) as f32 / 250.0).collect();
        let texture = Texture::new(&ImageRgb::new(SIZE.width, SIZE.height, values).unwrap());
        let homography_at_infinity = DMat3::from_translation(glam::DVec2::new(-3.3, 0.2));
        let sweep = PlaneSweep { homography_at_infinity, epipole: DVec3::new(-150.0, 20.0, 0.0) };
        let sources = [WarpSource::new(&texture, sweep)];
        let (mut colour, mut coverage) = (vec![9.0; 3 * pixels], vec![9.0; pixels]);
        let mut run_coverage = vec![RunCoverage::Partial; run_coverage_len(SIZE)];
        let mut seen = vec![0; run_coverage.len()];
        let mut met = [0; 3];
        for disparity in [0.0, 0.0, 1.0, 3.0, 3.0, 1.0, 0.0] {
            let disparity = vec![disparity; pixels];
            let mut layers = WarpedLayers {
                disparity: &disparity,
                colour: &mut colour,
                coverage: &mut coverage,
                run_coverage: &mut run_coverage,
                seen: &mut seen,
            };
            warp_layers_into(&sources, &[], SIZE, &mut layers);
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

    /// A slope, before it the same slope with a nearer step in its middle, and a photo whose own
    /// depth hides some of both.
    #[test]
    fn warp_layers_into_equal_runs_of_layers_equal_each_layer_alone() {
        const SIZE: Size = Size::new(200, 40);
        let pixels = SIZE.pixels();
        let values = (0..3 * pixels).map(|i| (i % 251) as f32 / 250.0).collect();
        let texture = Texture::new(&ImageRgb::new(SIZE.width, SIZE.height, values).unwrap());
        let homography_at_infinity = DMat3::from_translation(glam::DVec2::new(-3.3, 0.2));
        let sweep = PlaneSweep { homography_at_infinity, epipole: DVec3::new(-15.0, 2.0, 0.0) };
        let sources = [WarpSource { gains: [0.9, 1.1, 1.0], ..WarpSource::new(&texture, sweep) }];
        let own_disparity: Vec<f32> = (0..pixels).map(|i| if i % 7 == 0 { 3.0 } else { -1.0 }).collect();
        let own = [OwnDisparity { disparity: &own_disparity, margin: 1.0 }];
        let far: Vec<f32> = (0..pixels).map(|i| (i % SIZE.width) as f32 / 150.0).collect();
        let near = far.iter().enumerate().map(|(i, d)| if i % SIZE.width / 8 == 10 { d + 1.5 } else { *d });
        let both: Vec<f32> = near.chain(far.iter().copied()).collect();
        let runs = run_coverage_len(SIZE);
        let warp = |disparity: &[f32]| {
            let n = disparity.len() / pixels;
            let (mut colour, mut coverage) = (vec![9.0; 3 * n * pixels], vec![9.0; n * pixels]);
            let (mut run_coverage, mut seen) = (vec![RunCoverage::Partial; n * runs], vec![0; n * runs]);
            let mut layers = WarpedLayers {
                disparity,
                colour: &mut colour,
                coverage: &mut coverage,
                run_coverage: &mut run_coverage,
                seen: &mut seen,
            };
            warp_layers_into(&sources, &own, SIZE, &mut layers);
            (colour, coverage, run_coverage, seen)
        };
        let (together, alone) = (warp(&both), warp(&far));
        assert!(together.0[3 * pixels..] == alone.0 && together.1[pixels..] == alone.1);
        assert!(together.2[runs..] == alone.2 && together.3[runs..] == alone.3);
        let differing = together.3[..runs].iter().zip(&alone.3).filter(|(near, far)| near != far).count();
        assert!((20..runs / 2).contains(&differing), "{differing} of {runs} runs differ in what is hidden");
        let hidden: u32 = alone.3.iter().map(|seen| seen.count_zeros()).sum();
        assert!((pixels / 20..pixels / 5).contains(&(hidden as usize)), "{hidden} pixels hidden");
    }

    #[test]
    fn all_views_and_layers_are_warped_as_each_alone() {
        const SIZE: Size = Size::new(70, 75);
        let pixels = SIZE.pixels();
        let photo =
            |seed: usize| ImageRgb::new(70, 75, (0..3 * pixels).map(|i| (i * seed % 251) as f32 / 250.0).collect());
        let textures = [7, 11].map(|seed| Texture::new(&photo(seed).unwrap()));
        let sweep =
            |x: f64| PlaneSweep { homography_at_infinity: DMat3::IDENTITY, epipole: DVec3::new(x, 0.3 * x, 0.0) };
        let sources = [WarpSource::new(&textures[0], sweep(9.3)), WarpSource::new(&textures[1], sweep(-17.7))];
        let layers = [0.1, 0.5, 1.0, 2.0].map(|disparity| vec![disparity; pixels]);
        let warp = |layers: &[f32], sources: &[WarpSource<'_>]| {
            let values = layers.len() * sources.len();
            let (mut colour, mut coverage) = (vec![9.0; 3 * values], vec![9.0; values]);
            warp_layers(layers, sources, SIZE, &mut colour, &mut coverage);
            (colour, coverage)
        };
        let (colour, coverage) = warp(&layers.concat(), &sources);
        for (k, layer) in layers.iter().enumerate() {
            for (view, source) in sources.iter().enumerate() {
                let (alone, covered) = warp(layer, &[*source]);
                let at = (k * sources.len() + view) * pixels;
                assert!(colour[3 * at..][..3 * pixels] == alone && coverage[at..][..pixels] == covered, "{k} {view}");
            }
        }
    }
}
