//! Throughput of the native stages per layer, in bytes and samples per second, compared with a
//! plain copy of as many bytes: `cargo bench`.
//!
//! One layer at 504×352, V = 5, on rayon's threads; a sample is one pixel of one view. The bytes
//! are those that a stage must move: the warp writes colour and coverage, the blend reads them and
//! the logits.

use divan::Bencher;
use divan::counter::{BytesCount, ItemsCount};
use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics, PlaneSweep, Size};
use liveview::image::ImageRgb;
use liveview::render::{Accumulated, Blended, DistanceWeights, LayerSamples};
use liveview::warp::{Texture, WarpSource, warp_layers};
use rayon::prelude::*;

const SIZE: Size = Size::new(504, 352);
const PIXELS: usize = SIZE.pixels();
const VIEWS: usize = 5;

fn main() {
    divan::main();
}

fn camera(shift: f64, turn: f64) -> Camera {
    let intrinsics = Intrinsics { fx: 420.0, fy: 420.0, cx: 252.0, cy: 176.0, skew: 0.0 };
    let rotation = DMat3::from_rotation_y(turn);
    Camera::new(intrinsics, SIZE.width, SIZE.height, rotation, DVec3::new(shift, 0.3 * shift, 0.0)).unwrap()
}

/// Photos of waves, of rotated cameras or of a rectified rig (`turn` 0).
fn sources(textures: &[Texture], turn: f64) -> Vec<WarpSource<'_>> {
    let at = |view: usize| camera(0.1 * (view as f64 - 2.0), turn * (view as f64 - 2.0));
    let source = |(view, texture)| WarpSource::new(texture, PlaneSweep::new(&at(view), &camera(0.01, 0.0)));
    textures.iter().enumerate().map(source).collect()
}

fn textures() -> Vec<Texture> {
    let photo = |view: usize| {
        let wave = |at: usize| 0.5 + 0.5 * (at as f32 * (0.01 + 0.003 * view as f32)).sin();
        Texture::new(&ImageRgb::new(SIZE.width, SIZE.height, (0..3 * PIXELS).map(wave).collect()).unwrap())
    };
    (0..VIEWS).map(photo).collect()
}

/// As many bytes as the warp writes (4 planes of each view), and as the blend reads (5).
#[divan::bench(args = [4, 5])]
fn copy(bencher: Bencher, planes: usize) {
    let (from, mut to) = (vec![0.5_f32; planes * VIEWS * PIXELS], vec![0.0_f32; planes * VIEWS * PIXELS]);
    bencher.counter(ItemsCount::new(VIEWS * PIXELS)).counter(BytesCount::of_many::<f32>(to.len())).bench_local(|| {
        to.par_chunks_mut(PIXELS).zip(from.par_chunks(PIXELS)).for_each(|(to, from)| to.copy_from_slice(from));
        divan::black_box(&mut to);
    });
}

/// Rotated cameras on a plane and on a smooth map, and a rectified rig.
#[divan::bench(args = ["planes", "maps", "rectified"])]
fn warp(bencher: Bencher, case: &str) {
    let textures = textures();
    let sources = sources(&textures, if case == "rectified" { 0.0 } else { 0.01 });
    let smooth = |at: usize| 0.2 + 0.05 * ((at % SIZE.width) as f32 * 0.02).sin();
    let disparity: Vec<_> = (0..PIXELS).map(|at| if case == "maps" { smooth(at) } else { 0.2 }).collect();
    let (mut colour, mut coverage) = (vec![0.0; 3 * VIEWS * PIXELS], vec![0.0; VIEWS * PIXELS]);
    bencher
        .counter(ItemsCount::new(VIEWS * PIXELS))
        .counter(BytesCount::of_many::<f32>(4 * VIEWS * PIXELS))
        .bench_local(|| warp_layers(&disparity, &sources, SIZE, &mut colour, &mut coverage));
}

#[divan::bench]
fn blend_and_composite(bencher: Bencher) {
    let weights = DistanceWeights::new(&[0.1, 0.1, 0.2, 0.2, 0.3]);
    let logits: Vec<f32> = (0..VIEWS * PIXELS).map(|at| 4.0 * (at as f32 * 0.37).sin()).collect();
    let (colour, coverage) = (vec![0.5; 3 * VIEWS * PIXELS], vec![1.0; VIEWS * PIXELS]);
    let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage };
    let (disparity, mut rows) = (vec![0.2; SIZE.width], vec![Accumulated::new(SIZE.width); SIZE.height]);
    let bytes = BytesCount::of_many::<f32>(5 * VIEWS * PIXELS);
    bencher.counter(ItemsCount::new(VIEWS * PIXELS)).counter(bytes).bench_local(|| {
        rows.par_iter_mut().enumerate().for_each_init(
            || Blended::new(SIZE.width),
            |blended, (y, row)| {
                samples.blend(&weights, y * SIZE.width, blended);
                row.add(0, blended, &disparity, false);
            },
        );
    });
}
