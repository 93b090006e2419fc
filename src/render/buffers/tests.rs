//! Run coverage and slots of the buffers.

use glam::{DMat3, DVec2, DVec3};

use super::*;
use crate::geometry::PlaneSweep;
use crate::image::ImageRgb;
use crate::layers::Layers;
use crate::render::blend::{Blended, LayerSamples, blend_run};
use crate::warp::Texture;

const SIZE: Size = Size::new(400, 40);
const PIXELS: usize = SIZE.pixels();

/// Three planes and three views. The first two views cover nothing of the nearest plane, the
/// left and the right half of the next, and all but an edge of the farthest; the third view
/// covers all but an edge of each.
fn warped() -> Buffers {
    let values = (0..3 * PIXELS).map(|i| (i % 251) as f32 / 250.0).collect();
    let texture = Texture::new(&ImageRgb::new(SIZE.width, SIZE.height, values).unwrap());
    let source = |x, y| {
        let sweep = PlaneSweep {
            homography_at_infinity: DMat3::from_translation(DVec2::new(-3.3, 0.2)),
            epipole: DVec3::new(x, y, 0.0),
        };
        WarpSource::new(&texture, sweep)
    };
    let mut buffers = Buffers::default();
    buffers.make_room(3, 3, SIZE).unwrap();
    let planes = Layers::planes(&[2.0, 1.0, 1e-3]).unwrap();
    let sources = [source(-210.0, 5.0), source(210.0, -5.0), source(1.0, 0.5)];
    buffers.warp(planes.as_slice().iter().enumerate(), &sources, &[], &mut Vec::new());
    buffers
}

#[test]
fn run_coverage_does_not_change_the_blend_by_a_bit() {
    let mut buffers = warped();
    let logit = |i: usize| if i.is_multiple_of(97) { f32::INFINITY } else { (i * 31 % 113) as f32 / 9.0 - 6.0 };
    buffers.logits.iter_mut().enumerate().for_each(|(i, value)| *value = logit(i));
    let per_row = run_coverage_len(Size::new(SIZE.width, 1));
    let mut met = [0; 3];
    for distances in [[1.0, 2.0, 3.0], [0.0, 1.0, 0.0]] {
        let weights = DistanceWeights::new(&distances);
        for layer in 0..3 {
            let samples = LayerSamples {
                logits: &buffers.logits[3 * layer * PIXELS..][..3 * PIXELS],
                colour: &buffers.hwv[9 * layer * PIXELS..][..9 * PIXELS],
                coverage: buffers.coverage(layer),
                logit_shift: 0.0,
            };
            for row in 0..SIZE.height {
                let of_view = |view: usize| {
                    &buffers.run_coverage[((3 * layer + view) * SIZE.height + row) * per_row..][..per_row]
                };
                let run_coverage = [0, 1, 2].map(of_view);
                let [mut with_runs, mut without] = [(); 2].map(|()| Blended::new(SIZE.width));
                blend_run(&weights, &samples, row * SIZE.width, &run_coverage, &mut with_runs);
                weights.blend(&samples, row * SIZE.width, &mut without);
                assert_eq!(with_runs, without, "{distances:?}, layer {layer}, row {row}");
                // The blend takes two runs at once: it reads their coverage unless both have
                // the same summary.
                let pairs = run_coverage.iter().flat_map(|row| row.chunks_exact(2)).filter(|pair| pair[0] == pair[1]);
                pairs.for_each(|pair| met[pair[0] as usize] += 1);
            }
        }
    }
    assert!(met.iter().all(|&pairs| pairs > 20), "{met:?}");
}

#[test]
fn moved_layer_keeps_its_run_coverage() {
    let mut buffers = warped();
    let weights = DistanceWeights::new(&[1.0; 3]);
    let layer = |buffers: &Buffers, slot: usize| {
        let (batch, run_coverage) = buffers.batch(&[0.0; 3], &weights);
        let runs = run_coverage.len() / 3;
        let planes = [batch.hwv, batch.coverage].map(|planes| planes.index_axis_move(Axis(0), slot).to_owned());
        (planes, batch.disparity.index_axis(Axis(0), slot).to_owned(), run_coverage[slot * runs..][..runs].to_vec())
    };
    let (near, far) = (layer(&buffers, 0), layer(&buffers, 2));
    assert!(near.2 != far.2);
    buffers.move_layer(2, 0);
    assert!(layer(&buffers, 0) == far);
}
