//! Every stage on a scene of known depth: a square before a wall, photographed by cameras side by
//! side.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use ndarray::Array2;

use crate::aggregate::aggregate;
use crate::consistency::visible;
use crate::fusion::{splat_confirmed, warp_sources};
use crate::grid::{Candidates, Grid, Planes, SEGMENT};
use crate::nearer_edges::nearer_edges;
use crate::neighbourhood::{fill_holes, median3};
use crate::photo_sweep::{COST_SCALE, costs};
use crate::stages::{SurfaceView, anchored_depth, confirmed, exposure_gains, sharpening, surface};
use crate::target_search::{MAX_VARIANCE, SeenSurface, TargetSearch, photo_variance};
use crate::*;
use liveview::geometry::{Camera, Intrinsics, PlaneSweep, Size};
use liveview::image::ImageRgb;
use liveview::layers::{Layer, LayersError};
use liveview::warp::{NO_GAINS, SourceView, Texture, WarpSource};

const WIDTH: usize = 128;
const HEIGHT: usize = 96;
const FOCAL: f64 = 60.0;
const WALL: f64 = 0.125;
const SQUARE: f64 = 0.5;
const RANGE: (f64, f64) = (1.5, 10.0);

fn camera(x: f64) -> Camera {
    let intrinsics = Intrinsics { fx: FOCAL, fy: FOCAL, cx: 40.0, cy: 28.0, skew: 0.0 };
    Camera::new(intrinsics, WIDTH, HEIGHT, DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap()
}

/// Disparity of a pixel of the camera at `x`, and the point of the surface, in pixels of the camera
/// at 0.
fn ground_truth(x: f64, column: usize, row: usize) -> (f64, f64, f64) {
    let (u, v) = (column as f64 + 0.5, row as f64 + 0.5);
    let on_square = u + FOCAL * x * SQUARE;
    if (28.0..52.0).contains(&on_square) && (16.0..40.0).contains(&v) {
        (SQUARE, on_square, v)
    } else {
        (WALL, u + FOCAL * x * WALL, v)
    }
}

/// Photo of the camera at `x`, its channels multiplied by `exposure`.
fn photo(x: f64, exposure: [f32; 3]) -> ImageRgb {
    let colour = |i: usize| {
        let (disparity, u, v) = ground_truth(x, i % WIDTH, i / WIDTH);
        let wave = |a: f64, b: f64, c: f64| 0.5 + 0.24 * (a * u + b * v + c).sin() + 0.24 * (b * u - a * v).cos();
        let c = 10.0 * disparity;
        let colour = [wave(1.1, 0.4, c), wave(0.7, 0.9, 2.0 + c), wave(0.3, 1.3, 4.0 + c)];
        std::array::from_fn::<_, 3, _>(|channel| exposure[channel] * colour[channel] as f32)
    };
    let data = (0..WIDTH * HEIGHT).flat_map(colour).collect();
    ImageRgb::new(WIDTH, HEIGHT, data).unwrap()
}

const PLACES: [f64; 5] = [0.0, -0.2, 0.2, -0.4, 0.4];

struct Rig {
    cameras: Vec<Camera>,
    photos: Vec<Texture>,
}

impl Rig {
    fn new() -> Self {
        Self {
            cameras: PLACES.map(camera).to_vec(),
            photos: PLACES.map(|x| Texture::new(&photo(x, NO_GAINS))).to_vec(),
        }
    }

    fn view(&self, index: usize) -> SourceView<'_> {
        SourceView { camera: &self.cameras[index], texture: &self.photos[index] }
    }

    /// The first photos, with their confirmed depth.
    fn surface_views<'a>(&'a self, confirmed: &'a [Arc<ConfirmedDisparity>]) -> Vec<SurfaceView<'a>> {
        let view = |(k, confirmed): (usize, &'a Arc<ConfirmedDisparity>)| SurfaceView {
            view: self.view(k),
            confirmed,
            gains: NO_GAINS,
        };
        confirmed.iter().enumerate().map(view).collect()
    }

    /// The first photos, with their indices.
    fn set(&self, count: usize) -> Vec<(usize, SourceView<'_>)> {
        (0..count).map(|index| (index, self.view(index))).collect()
    }

    fn maps(&self) -> DepthMaps {
        let mut maps = DepthMaps::new(self.cameras.clone(), RANGE.0, RANGE.1);
        for index in 0..PLACES.len() {
            let neighbours: Vec<_> = maps.neighbours(index).into_iter().map(|k| self.view(k)).collect();
            maps.insert(index, anchored_depth(&self.view(index), &neighbours, RANGE.0, RANGE.1));
        }
        maps
    }
}

/// Share of pixels, without a border of eight, whose disparity is within a pixel of parallax.
fn correct_share(found: &Array2<f32>, x: f64, disparity_per_pixel: f32) -> f64 {
    let inner = |(y, x): (usize, usize)| (8..HEIGHT - 8).contains(&y) && (8..WIDTH - 8).contains(&x);
    let all: Vec<_> = found.indexed_iter().filter(|(at, _)| inner(*at)).collect();
    let good = |((row, column), d): &&((usize, usize), &f32)| {
        (**d - ground_truth(x, *column, *row).0 as f32).abs() < disparity_per_pixel
    };
    all.iter().filter(good).count() as f64 / all.len() as f64
}

#[test]
fn costs_are_lowest_on_the_surface_and_highest_where_unseen() {
    let rig = Rig::new();
    let reference = Planes::new(&rig.photos[0]);
    let sweep = |index: usize| PlaneSweep::new(&rig.cameras[index], &rig.cameras[0]);
    let sources = [1, 2].map(|index| WarpSource::new(&rig.photos[index], sweep(index)));
    let grid = Grid::new(1.0 / 0.625, 1.0 / 0.125, 17); // 0.5 is index 4, 0.125 the last
    let count = Candidates::All.count(&grid);
    let volume = costs(&reference, &sources, &grid, Candidates::All, None);
    let best = |x: usize, y: usize| {
        let cell = &volume[(y * WIDTH + x) * count..][..grid.count];
        (0..grid.count).min_by_key(|&k| cell[k]).unwrap()
    };
    assert_eq!((best(40, 28), best(14, 10)), (4, 16));
    let beside = WarpSource {
        sweep: PlaneSweep {
            homography_at_infinity: DMat3::from_translation(glam::DVec2::new(1e3, 0.0)),
            epipole: DVec3::ZERO,
        },
        ..sources[0]
    };
    let volume = costs(&reference, &[beside], &grid, Candidates::All, None);
    assert!(volume.iter().all(|&cost| cost == (0.15 * COST_SCALE).round() as u16));
}

#[test]
fn segments_covering_the_grid_give_the_result_of_all_candidates() {
    let rig = Rig::new();
    let reference = Planes::new(&rig.photos[0]);
    let sweep = PlaneSweep::new(&rig.cameras[2], &rig.cameras[0]);
    let sources = [WarpSource::new(&rig.photos[2], sweep)];
    let grid = Grid::new(RANGE.0, RANGE.1, 2 * SEGMENT);
    let starts = vec![[0, SEGMENT as u16]; WIDTH * HEIGHT];
    let segments = Candidates::Segments { starts: &starts, columns: WIDTH, cells_per_side: 1 };
    let [all, segments] = [Candidates::All, segments].map(|candidates| {
        let volume = costs(&reference, &sources, &grid, candidates, None);
        (aggregate(&volume, &reference, &grid, candidates), volume)
    });
    assert!(all == segments);
}

#[test]
fn aggregate_cell_without_texture_takes_its_neighbours_index() {
    let flat = Planes::new(&Texture::new(&ImageRgb::new(5, 4, vec![0.5; 60]).unwrap()));
    let grid = Grid::new(1.0, 2.0, 2 * SEGMENT);
    let cost = |i: usize| {
        let (cell, k) = (i / (2 * SEGMENT), i % (2 * SEGMENT));
        if cell != 12 && k == 5 { 0 } else { 1000 }
    };
    let volume: Vec<u16> = (0..20 * 2 * SEGMENT).map(cost).collect();
    let found = aggregate(&volume, &flat, &grid, Candidates::All);
    assert!(found.iter().all(|&index| index == 5.0), "{found:?}");
}

#[test]
fn depth_and_surface_are_within_a_pixel_of_the_truth() {
    let rig = Rig::new();
    let mut maps = rig.maps();
    let confirmed = maps.mutually_confirmed(&rig.set(5));
    for (index, confirmed) in confirmed.iter().enumerate() {
        let found = maps.get(index).unwrap();
        let share = correct_share(&found.disparity, PLACES[index], found.disparity_per_pixel);
        assert!(share > 0.93, "photo {index}: {share}");
        let count = confirmed.disparity.iter().filter(|d| **d >= 0.0).count();
        assert!(count as f64 > 0.8 * (WIDTH * HEIGHT) as f64, "photo {index}: {count} confirmed");
    }
    let views = rig.surface_views(&confirmed);
    let target = camera(0.1);
    let found = surface(&views, &target, RANGE);
    let share = correct_share(&found.disparity, 0.1, found.disparity_per_pixel);
    assert!(share > 0.95, "{share}");
    let layers = found.layers(3).unwrap();
    let values = |layer: usize| match &layers.as_slice()[layer] {
        Layer::Pixels(map) => map.clone(),
        other => panic!("{other:?}"),
    };
    assert_eq!(layers.len(), 3);
    assert_eq!(values(1), found.disparity, "the surface itself is between its extremes");
    let ordered = |(near, (own, far)): (&f32, (&f32, &f32))| near >= own && own >= far;
    assert!(values(0).iter().zip(values(1).iter().zip(&values(2))).all(ordered));
    assert_ne!(values(0), values(2), "it has edges");
    assert!(matches!(found.layers(0), Err(LayersError::Empty)));
}

#[test]
fn surface_equals_its_definition() {
    let rig = Rig::new();
    let mut maps = rig.maps();
    let confirmed = maps.mutually_confirmed(&rig.set(4));
    let (target, size) = (camera(0.1), Size::new(WIDTH, HEIGHT));
    let pixel = (1.0 / (FOCAL * 0.5)) as f32;
    for has_holes in [false, true] {
        // Below, where filling them from beside is right, and on the square, where only a search is.
        let is_hole = |y: usize, d: f32| has_holes && (y >= 76 || (20..36).contains(&y) && d > 0.3);
        let with_holes = |map: &Arc<ConfirmedDisparity>| {
            let value = |((y, _), &d): ((usize, usize), &f32)| if is_hole(y, d) { -1.0 } else { d };
            let values = map.disparity.indexed_iter().map(value).collect();
            let disparity = Array2::from_shape_vec((HEIGHT, WIDTH), values).unwrap();
            Arc::new(ConfirmedDisparity { disparity, ..*map.as_ref() })
        };
        let confirmed: Vec<_> = confirmed.iter().map(with_holes).collect();
        let views = rig.surface_views(&confirmed);
        let found = surface(&views, &target, RANGE);
        assert!((found.disparity_per_pixel - pixel).abs() < 1e-6, "{}", found.disparity_per_pixel);

        let splatted = splat_confirmed(&views, &target, found.disparity_per_pixel);
        let guessed: Vec<bool> = splatted.iter().map(|&d| d < 0.0).collect();
        let share = guessed.iter().filter(|guessed| **guessed).count() as f64 / (WIDTH * HEIGHT) as f64;
        assert!(found.guessed.iter().eq(&guessed) && found.guessed_share() == share);
        assert_eq!(share > 0.05, has_holes, "{share}");
        let mut expected = fill_holes(&splatted, WIDTH);
        let mut doubted = vec![false; WIDTH * HEIGHT];
        if has_holes {
            let (sources, margin) = (warp_sources(&views, &target), 4.0 * found.disparity_per_pixel);
            let (views, sources, splatted) = (&views[..], &sources[..], &splatted[..]);
            let search = TargetSearch { views, sources, target: &target, splatted, size, range: RANGE, margin };
            let planes = search.planes();
            let searched = search.disparity(&planes, search.costs(&planes).view());
            let variance = |disparity: &[f32]| {
                let visible_to = |view: &SurfaceView<'_>| {
                    visible((view.view.camera, view.confirmed), &target, disparity, WIDTH, margin)
                };
                let visible: Vec<_> = views.iter().map(visible_to).collect();
                photo_variance(&SeenSurface { disparity, splatted, width: WIDTH, sources, visible: &visible })
            };
            let (of_filled, of_searched) = (variance(&expected), variance(&searched));
            let holes = (0..splatted.len()).filter(|&at| guessed[at]);
            let (kept, replaced): (Vec<_>, Vec<_>) =
                holes.partition(|&at| of_filled[at] < 0.9 * of_searched[at] - 1e-7);
            assert!(kept.len() > 20 && replaced.len() > 20, "{} and {}", kept.len(), replaced.len());
            for (pixels, variance) in [(&kept, &of_filled), (&replaced, &of_searched)] {
                pixels.iter().for_each(|&at| doubted[at] = variance[at] >= 0.002);
            }
            replaced.into_iter().for_each(|at| expected[at] = searched[at]);
        }
        assert!(found.doubted.iter().eq(&doubted));
        assert_eq!(found.confidence().is_some(), has_holes);
        let trusted = |at: usize| f64::from(found.confidence().unwrap().as_slice().unwrap()[at]);
        let number = doubted.iter().filter(|&&doubted| doubted).count();
        assert!(!has_holes || (20..2000).contains(&number), "{number}");
        for at in (0..WIDTH * HEIGHT).step_by(7).filter(|_| has_holes) {
            let (y, x) = (at / WIDTH, at % WIDTH);
            let window: Vec<bool> = (y.saturating_sub(5)..(y + 6).min(HEIGHT))
                .flat_map(|y| &doubted[y * WIDTH..][x.saturating_sub(5)..(x + 6).min(WIDTH)])
                .copied()
                .collect();
            let share = window.iter().filter(|&&doubted| doubted).count() as f64 / window.len() as f64;
            let expected = if doubted[at] { 1.0 - 0.99 * share } else { 1.0 };
            assert!((trusted(at) - expected).abs() < 1e-6, "{at}: {} {expected}", trusted(at));
        }
        assert!(found.disparity.iter().eq(&median3(&expected, WIDTH)), "holes: {has_holes}");
    }
    let views = rig.surface_views(&confirmed[..1]);
    let range = (1.0 / RANGE.0 - 1.0 / RANGE.1) as f32;
    let found = surface(&views, &camera(0.001), RANGE).disparity_per_pixel;
    assert!((found - range).abs() < 1e-6, "a parallax below a pixel counts as one: {found}");
}

#[test]
fn layers_divide_the_range_of_three_by_three_pixels() {
    let disparity = Array2::from_shape_fn((8, 16), |(y, x)| 0.1 + ((7 * y + 5 * x) % 11) as f32 / 16.0);
    let guessed = Array2::from_elem((8, 16), false);
    let (disparity_per_pixel, doubted) = (0.1, guessed.clone());
    let surface = Surface { disparity: disparity.clone(), disparity_per_pixel, guessed, doubted };
    let around = |y: usize, x: usize, f: fn(f32, f32) -> f32| {
        let rows = y.saturating_sub(1)..(y + 2).min(8);
        let values = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(16)).map(move |x| (y, x)));
        values.map(|at| disparity[at]).reduce(f).unwrap()
    };
    for count in 1..6 {
        let layers = surface.layers(count).unwrap();
        assert_eq!(layers.len(), count);
        for (k, layer) in layers.as_slice().iter().enumerate() {
            let Layer::Pixels(map) = layer else { panic!("{layer:?}") };
            for ((y, x), &found) in map.indexed_iter() {
                let (near, far) = (around(y, x, f32::max), around(y, x, f32::min));
                let expected = match (count, k) {
                    (1, _) | (3, 1) => disparity[(y, x)],
                    (_, k) if k + 1 == count => far,
                    (_, k) => near + k as f32 / (count - 1) as f32 * (far - near),
                };
                assert_eq!(found, expected, "layer {k} of {count} at {x}, {y}");
            }
        }
    }
}

#[test]
fn depth_inserted_again_is_confirmed_alike() {
    let rig = Rig::new();
    let mut maps = rig.maps();
    let expected = maps.mutually_confirmed(&rig.set(5));
    let depth = maps.get(2).unwrap().clone();
    maps.insert(2, depth);
    let found = maps.mutually_confirmed(&rig.set(5));
    assert!(found.iter().zip(expected).all(|(found, expected)| found.disparity == expected.disparity));
}

#[test]
fn confirmed_contradicted_depth_is_rejected() {
    let flat = |disparity: f32| PhotoDisparity {
        disparity: Array2::from_elem((HEIGHT, WIDTH), disparity),
        disparity_per_pixel: 0.02,
    };
    let cameras = [camera(0.0), camera(0.1)];
    let (good, mut bad) = (flat(0.2), flat(0.2));
    bad.disparity[(20, 40)] = 0.5; // in front of the wall that the other photo sees
    let votes = ConsistencyVotes::new((&cameras[0], &bad), (&cameras[1], &good));
    let found = confirmed(&[&votes], (HEIGHT, WIDTH));
    assert!(!found[(20, 40)]);
    assert!(found.indexed_iter().filter(|((_, x), _)| *x > 2).all(|(at, &ok)| ok || at == (20, 40)));
    assert!(confirmed(&[], (HEIGHT, WIDTH)).iter().all(|&ok| !ok), "nothing is confirmed without votes");
}

#[test]
fn depth_beside_an_edge_becomes_nearer_where_two_photos_and_the_colours_say_so() {
    let rig = Rig::new();
    let truth = |x: f64| PhotoDisparity {
        disparity: Array2::from_shape_fn((HEIGHT, WIDTH), |(row, column)| ground_truth(x, column, row).0 as f32),
        disparity_per_pixel: 0.08,
    };
    // The square's left column, and the column of the wall before it.
    let with_columns = |x: f64, square: f64, before: f64| {
        let mut map = truth(x);
        let left = (28.0 - FOCAL * x * SQUARE) as usize;
        (16..40).for_each(|row| {
            (map.disparity[(row, left)], map.disparity[(row, left - 1)]) = (square as f32, before as f32)
        });
        map
    };
    let moved = |maps: &[PhotoDisparity; 3], confirmed: bool| {
        let set: Vec<_> = maps.iter().enumerate().map(|(index, map)| (rig.view(index), map)).collect();
        let confirmed = ConfirmedDisparity::new(&maps[0], &Array2::from_elem((HEIGHT, WIDTH), confirmed));
        nearer_edges(&set, 0, &confirmed).disparity
    };
    let [right, narrow] = [SQUARE, WALL].map(|square| with_columns(PLACES[0], square, WALL));
    let [second, third] = [1, 2].map(|index| truth(PLACES[index]));
    let found = moved(&[narrow.clone(), second.clone(), third.clone()], true);
    assert!((&found - &right.disparity).iter().all(|difference| difference.abs() < 1e-6), "the square is whole");
    let unconfirmed = moved(&[narrow.clone(), second.clone(), third], false);
    assert_eq!(unconfirmed, narrow.disparity, "no place where the others are trusted");
    let single = moved(&[narrow.clone(), second, narrow.clone()], true);
    assert_eq!(single, narrow.disparity, "one photo has that depth: the other's lies elsewhere");
    let wide = [1, 2].map(|index| with_columns(PLACES[index], SQUARE, SQUARE));
    let [second, third] = wide;
    assert_eq!(moved(&[right.clone(), second, third], true), right.disparity, "the wall has other colours");
}

#[test]
fn visible_point_behind_the_views_own_depth_is_hidden() {
    let target = camera(0.0);
    let mut map = ConfirmedDisparity { disparity: Array2::from_elem((HEIGHT, WIDTH), 0.1), disparity_per_pixel: 0.01 };
    map.disparity[(10, 20)] = 0.5;
    map.disparity[(10, 21)] = -1.0;
    let seen = visible((&target, &map), &target, &[0.1; WIDTH * HEIGHT], WIDTH, 0.05);
    for (at, &seen) in seen.iter().enumerate() {
        assert_eq!(seen == 0.0, at == 10 * WIDTH + 20, "{at}");
    }
    // A point in front of what the view itself confirms: the view sees past it.
    let seen = visible((&target, &map), &target, &[0.2; WIDTH * HEIGHT], WIDTH, 0.05);
    for (at, &seen) in seen.iter().enumerate() {
        let expected = [(10 * WIDTH + 20, 0.0), (10 * WIDTH + 21, 1.0)].iter().find(|(pixel, _)| *pixel == at);
        assert_eq!(seen, expected.map_or(-1.0, |&(_, value)| value), "{at}");
    }
}

#[test]
fn photo_variance_is_low_on_the_surface_only() {
    let rig = Rig::new();
    let sources = [0, 1, 2].map(|k| WarpSource::new(&rig.photos[k], PlaneSweep::new(&rig.cameras[k], &rig.cameras[0])));
    let visible = vec![vec![1.0; WIDTH * HEIGHT]; 3];
    let variance = |visible: &[Vec<f32>], disparity: &[f32], splatted: &[f32]| {
        photo_variance(&SeenSurface { disparity, splatted, width: WIDTH, sources: &sources, visible })
    };
    let [wall, before] = [WALL, WALL + 0.2].map(|disparity| vec![disparity as f32; WIDTH * HEIGHT]);
    let all_holes = vec![-1.0; WIDTH * HEIGHT];
    let at = 8 * WIDTH + 30;
    let [on, off] = [&wall, &before].map(|map| variance(&visible, map, &all_holes)[at]);
    assert!(on < 1e-3 && off > 5e-3, "{on} {off}");
    let blind = vec![vec![0.0; WIDTH * HEIGHT]; 3];
    let found = variance(&blind, &wall, &all_holes);
    assert!(found.iter().all(|&d| (d - MAX_VARIANCE).abs() < 1e-8));
    let past = vec![vec![1.0; WIDTH * HEIGHT], vec![-1.0; WIDTH * HEIGHT], vec![1.0; WIDTH * HEIGHT]];
    let found = variance(&past, &wall, &all_holes);
    assert!((found[at] - MAX_VARIANCE).abs() < 1e-8);
    let mut asked = vec![0.0; WIDTH * HEIGHT];
    asked[at] = -1.0;
    let found = variance(&visible, &wall, &asked);
    assert!(found.iter().enumerate().all(|(k, &d)| d == if k == at { on } else { 0.0 }));
}

#[test]
fn neighbours_of_a_photo_are_the_nearest_others() {
    let maps = DepthMaps::new(Rig::new().cameras, RANGE.0, RANGE.1);
    assert_eq!(maps.neighbours(1), [0, 3, 2, 4]);
    assert_eq!(DepthMaps::new(vec![camera(0.0)], RANGE.0, RANGE.1).neighbours(0), [0; 0]);
}

#[test]
fn anchored_depth_of_enlarged_photos_is_found_at_half_their_size() {
    let (width, height) = (5 * WIDTH, 5 * HEIGHT);
    let enlarged = |x: f64| {
        let photo = Texture::new(&photo(x, NO_GAINS).resized(width, height).unwrap());
        (camera(x).with_size_scaled(width, height).unwrap(), photo)
    };
    let photos = PLACES.map(enlarged);
    let views: Vec<_> = photos.iter().map(|(camera, texture)| SourceView { camera, texture }).collect();
    let found = anchored_depth(&views[0], &views[1..], RANGE.0, RANGE.1);
    let sampled = Array2::from_shape_fn((HEIGHT, WIDTH), |(y, x)| found.disparity[(5 * y + 2, 5 * x + 2)]);
    assert!(found.disparity.indexed_iter().all(|((y, x), &d)| d == found.disparity[(y & !1, x & !1)]));
    let share = correct_share(&sampled, 0.0, 5.0 * found.disparity_per_pixel);
    assert!(share > 0.95, "{share}");
}

#[test]
fn seen_range_ends_beside_the_nearest_and_the_farthest_surface() {
    let rig = Rig::new();
    let mut maps = rig.maps();
    let found = TargetSurface::find(&mut maps, &rig.set(4), 3, &camera(0.1), PhotoCorrection::default());
    let (near, far) = found.seen_range(RANGE);
    let pixel = f64::from(found.surface.disparity_per_pixel);
    assert!((SQUARE..SQUARE + 4.0 * pixel).contains(&(1.0 / near)), "{near}");
    assert!((WALL - 4.0 * pixel..WALL).contains(&(1.0 / far)), "{far}");
    assert_eq!(found.seen_range((3.0, 4.0)), (3.0, 4.0), "never beyond the range");
}

#[test]
fn surface_any_number_of_threads_gives_the_same_bits() {
    let rig = Rig::new();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut maps = rig.maps();
            let confirmed = maps.mutually_confirmed(&rig.set(5));
            let views = rig.surface_views(&confirmed[..4]);
            let found = surface(&views, &camera(0.07), RANGE).disparity;
            let correction = exposure_gains(&views, &[1.0; 4]).concat().into_iter().chain(sharpening(&views));
            found.into_iter().chain(correction).map(f32::to_bits).collect::<Vec<_>>()
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(3) && one == run(5));
}

#[test]
fn exposure_gains_of_a_darker_photo_are_found() {
    let rig = Rig::new();
    let mut maps = rig.maps();
    let confirmed = maps.mutually_confirmed(&rig.set(2));
    let darker = Texture::new(&photo(PLACES[1], [0.8, 0.9, 1.0]));
    let mut views = rig.surface_views(&confirmed);
    views[1].view.texture = &darker;
    let gains = exposure_gains(&views, &[1.0, 1.0]);
    for (c, expected) in [0.8_f32, 0.9, 1.0].into_iter().enumerate() {
        let found = gains[0][c] / gains[1][c];
        assert!((found - expected).abs() < 0.02, "channel {c}: {found}");
        assert!((gains[0][c] * gains[1][c] - 1.0).abs() < 1e-5);
    }
}

#[test]
fn pair_statistics_are_kept_while_the_photos_stay_the_same() {
    let rig = Rig::new();
    let mut maps = rig.maps();
    let darker = Texture::new(&photo(PLACES[1], [0.8, 0.9, 1.0]));
    let find = |maps: &mut DepthMaps, x: f64, second: &Texture| {
        let view =
            |index| SourceView { texture: if index == 1 { second } else { &rig.photos[index] }, ..rig.view(index) };
        let mut photos: Vec<_> = (0..4).map(|index| (index, view(index))).collect();
        photos.sort_by(|a, b| (PLACES[a.0] - x).abs().total_cmp(&(PLACES[b.0] - x).abs()));
        let found = TargetSurface::find(maps, &photos, 3, &camera(x), PhotoCorrection::default());
        found.corrections
    };
    for (x, second) in [(0.05, &rig.photos[1]), (0.02, &rig.photos[1]), (-0.15, &rig.photos[1]), (-0.12, &darker)] {
        let mut fresh = maps.clone();
        fresh.statistics = Default::default();
        let (found, expected) = (find(&mut maps, x, second), find(&mut fresh, x, second));
        assert_eq!(found, expected, "{x}");
        let kept = maps.statistics.sharpness.len();
        find(&mut maps, x + 0.01, second);
        assert_eq!(maps.statistics.sharpness.len(), kept, "another target computes nothing again");
    }
    assert_eq!(maps.statistics.gains.len(), 3, "statistics of a changed photo are dropped");
}

#[test]
fn photo_variance_equals_its_definition() {
    let rig = Rig::new();
    let gains = [[1.0; 3], [1.05, 0.95, 1.0], [0.9, 1.0, 1.1]];
    let sweep = |k: usize| PlaneSweep::new(&rig.cameras[k], &rig.cameras[0]);
    let sources = [0, 1, 2].map(|k| WarpSource { gains: gains[k], ..WarpSource::new(&rig.photos[k], sweep(k)) });
    let pixels = WIDTH * HEIGHT;
    // A wall, and a stripe before it; each view sees most of it, and past some of it.
    let disparity: Vec<f32> =
        (0..pixels).map(|at| if (at % WIDTH / 16).is_multiple_of(3) { 0.3 } else { 0.125 }).collect();
    let seen = |k: usize| {
        (0..pixels)
            .map(|at| match (at / 5 + 7 * k * at / 11) % 13 {
                0 => -1.0,
                1 | 2 => 0.0,
                _ => 1.0,
            })
            .collect()
    };
    let visible: Vec<Vec<f32>> = (0..3).map(seen).collect();
    let splatted: Vec<f32> = (0..pixels).map(|at| if at % 3 == 0 { 0.2 } else { -1.0 }).collect();
    let found = photo_variance(&SeenSurface {
        disparity: &disparity,
        splatted: &splatted,
        width: WIDTH,
        sources: &sources,
        visible: &visible,
    });
    let (mut colour, mut coverage) = (vec![0.0; 9 * pixels], vec![0.0; 3 * pixels]);
    liveview::warp::warp_layers(
        &disparity,
        &sources,
        liveview::geometry::Size::new(WIDTH, HEIGHT),
        &mut colour,
        &mut coverage,
    );
    let variance = |at: usize| {
        let inside = |k: &usize| coverage[k * pixels + at] > 0.5;
        let past = (0..3).filter(inside).any(|k| visible[k][at] < 0.0);
        let seeing: Vec<usize> = (0..3).filter(inside).filter(|&k| visible[k][at] > 0.0).collect();
        let channel = |c: usize| {
            let value = |&k: &usize| f64::from(colour[(3 * k + c) * pixels + at] / coverage[k * pixels + at]);
            let mean = seeing.iter().map(value).sum::<f64>() / seeing.len() as f64;
            seeing.iter().map(value).map(|value| (value - mean).powi(2)).sum::<f64>()
        };
        if past || seeing.len() < 2 {
            0.02
        } else {
            ((0..3).map(channel).sum::<f64>() / (3 * (seeing.len() - 1)) as f64).min(0.02)
        }
    };
    let variances: Vec<f64> = (0..pixels).map(variance).collect();
    let mut decided = [0; 2];
    variances.iter().for_each(|&variance| decided[usize::from(variance < 0.02)] += 1);
    assert!(decided.iter().all(|&count| count > pixels / 10), "{decided:?}");
    for (at, &found) in found.iter().enumerate() {
        if splatted[at] >= 0.0 {
            assert_eq!(found, 0.0);
            continue;
        }
        let around = |at: usize, side: usize| at.saturating_sub(3)..(at + 4).min(side);
        let (rows, columns) = (around(at / WIDTH, HEIGHT), around(at % WIDTH, WIDTH));
        let sum: f64 =
            rows.clone().flat_map(|y| columns.clone().map(move |x| y * WIDTH + x)).map(|at| variances[at]).sum();
        let expected = sum / (rows.len() * columns.len()) as f64;
        assert!((f64::from(found) - expected).abs() < 1e-6, "{at}: {found}, not {expected}");
    }
}

#[test]
fn depth_beside_an_edge_becomes_nearer_where_the_colours_decide_nothing() {
    let grey = Texture::new(&ImageRgb::new(WIDTH, HEIGHT, vec![0.5; 3 * WIDTH * HEIGHT]).unwrap());
    let cameras = PLACES.map(camera);
    let truth = |x: f64| Array2::from_shape_fn((HEIGHT, WIDTH), |(row, column)| ground_truth(x, column, row).0 as f32);
    let mut maps = [0, 1, 2].map(|k| PhotoDisparity { disparity: truth(PLACES[k]), disparity_per_pixel: 0.08 });
    (16..40).for_each(|row| maps[0].disparity[(row, 28)] = WALL as f32); // the square's left column
    let set: Vec<_> =
        maps.iter().zip(&cameras).map(|(map, camera)| (SourceView { camera, texture: &grey }, map)).collect();
    let confirmed = ConfirmedDisparity::new(&maps[0], &Array2::from_elem((HEIGHT, WIDTH), true));
    let found = nearer_edges(&set, 0, &confirmed).disparity;
    assert!((&found - &truth(PLACES[0])).iter().all(|difference| difference.abs() < 1e-6));
}

#[test]
fn sharpening_leaves_out_what_shows_another_point() {
    let rig = Rig::new();
    let photo = photo(0.0, NO_GAINS);
    let detail = |x: usize, y: usize, c: usize| {
        let at = |x: usize, y: usize| photo.pixel(x.min(WIDTH - 1), y.min(HEIGHT - 1))[c];
        4.0 * at(x, y) - at(x.saturating_sub(1), y) - at(x + 1, y) - at(x, y.saturating_sub(1)) - at(x, y + 1)
    };
    let sharper = |i: usize| {
        let (x, y, c) = (i / 3 % WIDTH, i / 3 / WIDTH, i % 3);
        let detail = detail(x, y, c);
        // Some of the compared pixels show something else.
        photo.pixel(x, y)[c] + if (x / 8 + y / 8) % 5 == 0 { 0.3 * detail.signum() } else { 0.03 * detail }
    };
    let sharper = Texture::new(&ImageRgb::new(WIDTH, HEIGHT, (0..3 * WIDTH * HEIGHT).map(sharper).collect()).unwrap());
    let confirmed =
        ConfirmedDisparity { disparity: Array2::from_elem((HEIGHT, WIDTH), 0.2), disparity_per_pixel: 0.01 };
    let view = |texture| SurfaceView {
        view: SourceView { camera: &rig.cameras[0], texture },
        confirmed: &confirmed,
        gains: NO_GAINS,
    };
    let found = sharpening(&[view(&rig.photos[0]), view(&sharper)]);
    assert!((found[0] - 0.03).abs() < 1e-4 && found[1] == 0.0, "{found:?}");
}
