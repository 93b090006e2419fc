//! The photos' depth and the target's surface, stage by stage, against the float64 oracle and float32 torch, on the goldens
//! of `parity/generate.py` (`make test-rust` generates them).
//!
//! Each stage is fed the float32 roundings of the oracle's outputs of the stage before. Elements whose decision hangs on the
//! last bits are marked doubtful by the oracle (`liveview_ref/parity/surface_goldens.py`): they may be off, but only few are
//! doubtful. All others lie within the bounds of `parity/tolerances.json`.

mod surface_case;

use liveview::geometry::distance;
use liveview::layers::{Layer, padded};
use liveview::render::{Visibility, VisibleView};
use liveview::surface::stages::{self, Search};
use liveview::surface::{ConsistencyVotes, confirmed, exposure_gains, photo_depth, sharpening, surface};
use ndarray::{Array1, Array2, Axis};
use surface_case::{Case, folder};

const CASES: [&str; 11] = [
    "scene",
    "many",
    "sizes",
    "one_neighbour",
    "rectified",
    "identical",
    "flat",
    "exposure",
    "infinity",
    "near_is_far",
    "planes_4096",
];

/// Layers along the surface, as many as `liveview_ref/parity/surface_stages.py` makes.
const LAYERS: usize = 3;
/// By how much the surface is moved on which the views may disagree, px, as there.
const OFFSETS: [f32; 7] = [1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -1.5];

/// On each of the cases, whose failures are told together.
fn for_cases(names: &[&'static str], check: impl Fn(&Case)) {
    let failures = names.iter().flat_map(|name| {
        let case = Case::open(name);
        check(&case);
        case.failures.into_inner().unwrap()
    });
    let failures: Vec<_> = failures.collect();
    assert!(failures.is_empty(), "{} beyond their bounds:\n{}", failures.len(), failures.join("\n"));
}

fn for_all(check: impl Fn(&Case)) {
    for_cases(&CASES, check);
}

/// All but the last, which has the first search alone.
fn for_whole(check: impl Fn(&Case)) {
    for_cases(&CASES[..CASES.len() - 1], check);
}

#[test]
fn every_generated_case_is_tested() {
    let listed =
        std::fs::read_to_string(folder().join("surface_cases.txt")).expect("run `make test-rust`, which generates it");
    assert_eq!(listed.lines().collect::<Vec<_>>(), CASES);
}

#[test]
fn half_resolution() {
    for_all(|case| {
        let search = Search { range: case.range, count: case.count, parts: 1, cell: 2, starts: None };
        let found = stages::matching_costs(&case.view(0), &case.neighbours(0), &search);
        case.check("half_costs", &found);
        let costs = case.volume::<u16>("half_costs");
        case.check("half_found", &stages::aggregated(&costs, &case.textures[0], &search, &case.settings));
        case.check("half_index", &stages::median3(&case.map("half_found")));
        let fine = (case.count - 1) * case.settings.parts + 1;
        case.check("starts", &stages::bands(&case.map("half_index"), case.settings.parts, fine));
    });
}

#[test]
fn narrow_band() {
    for_whole(|case| {
        let starts = case.volume::<u16>("starts");
        let (range, count, parts) = (case.range, case.count, case.settings.parts);
        let search = Search { range, count, parts, cell: 1, starts: Some(&starts) };
        let mut found = stages::matching_costs(&case.view(0), &case.neighbours(0), &search);
        // What a cell does not have is anything.
        let missing = |y: usize, x: usize| starts[(y / 2, x / 2, 1)] == u16::MAX;
        found.indexed_iter_mut().filter(|((y, x, k), _)| *k >= 8 && missing(*y, *x)).for_each(|(_, cost)| *cost = 0);
        case.check("fine_costs", &found);
        let costs = case.volume::<u16>("fine_costs");
        case.check("fine_found", &stages::aggregated(&costs, &case.textures[0], &search, &case.settings));
        case.check("fine_index", &stages::median3(&case.map("fine_found")));
    });
}

#[test]
fn depth_of_each_photo() {
    for_whole(|case| {
        for which in 0..case.cameras.len() {
            let neighbours = case.neighbours(which);
            let found = photo_depth(&case.view(which), &neighbours, case.range.0, case.range.1, &case.settings);
            case.check(&format!("depth{which}"), &found.disparity);
            let pixel = case.get::<f32>("pixel")[[which]];
            assert!((found.pixel / pixel - 1.0).abs() < 3e-7, "{}: a pixel is {}, not {pixel}", case.name, found.pixel);
        }
    });
}

#[test]
fn consistency() {
    for_whole(|case| {
        let depths = case.depths();
        let maps: Vec<_> = case.cameras.iter().zip(&depths).collect();
        for which in 0..maps.len() {
            let others = (0..maps.len()).filter(|&other| other != which);
            let opinions: Vec<_> =
                others.map(|other| ConsistencyVotes::new(maps[which], maps[other], &case.settings)).collect();
            let found = confirmed(&opinions.iter().collect::<Vec<_>>(), depths[which].disparity.dim());
            case.check(&format!("confirmed{which}"), &found.mapv(|sure| if sure { 1.0_f32 } else { 0.0 }));
        }
    });
}

#[test]
fn carried_to_the_target() {
    for_whole(|case| {
        let (pixel, size) = (case.pixel(), padded(case.target.size()));
        case.with_views(|views| {
            let maps: Vec<_> = views.iter().map(|v| (v.view.camera, v.known)).collect();
            let margins = (case.settings.agree * pixel, case.settings.fuse * pixel);
            case.check("splat", &stages::splatted(&maps, &case.target, size, margins));
            case.check("filled", &stages::fill_holes(&case.map("splat")));
            let (map, margin) = (case.map("filled"), case.settings.hides * pixel);
            let seen: Vec<_> = maps.iter().map(|&m| stages::visible(m, &case.target, &map, margin)).collect();
            let seen: Vec<_> = seen.iter().map(|map| map.view()).collect();
            case.check("visible", &ndarray::stack(Axis(0), &seen).unwrap());
        });
    });
}

#[test]
fn disagreement_of_the_views() {
    for_whole(|case| {
        let ((sources, visible), map, pixel) = (case.at_target(), case.map("filled"), case.pixel());
        let moved = |offset: f32| map.mapv(|disparity| (disparity + offset * pixel).max(0.0));
        let found = OFFSETS.map(|offset| stages::photo_variances(&sources, &visible, &moved(offset)));
        case.check("photo_variance", &ndarray::stack(Axis(0), &found.each_ref().map(|map| map.view())).unwrap());
    });
}

#[test]
fn surface_from_what_is_known() {
    for_whole(|case| {
        let ((near, far), target) = (case.range, &case.target);
        let found = case.with_views(|views| surface(views, target, near, far, &case.settings));
        case.check("surface", &found.disparity);
        let layers = found.layers(LAYERS).unwrap();
        let map = |layer: &Layer| if let Layer::Pixels(map) = layer { map.clone() } else { panic!("not by pixel") };
        let maps: Vec<_> = layers.as_slice().iter().map(map).collect();
        case.check("layers", &ndarray::stack(Axis(0), &maps.iter().map(|m| m.view()).collect::<Vec<_>>()).unwrap());
    });
}

#[test]
fn hidden_from_views() {
    for_whole(|case| {
        let (map, pixel) = (case.map("filled"), case.pixel());
        let (colour, coverage, seen) = case.with_views(|views| {
            let seen =
                views.iter().map(|v| VisibleView { disparity: &v.known.disparity, gains: v.gains, sharpening: 0.0 });
            let visibility = Visibility { views: seen.collect(), margin: case.settings.hides * pixel };
            let views: Vec<_> = views.iter().map(|v| v.view).collect();
            stages::hidden(&visibility, &views, &case.target, &map)
        });
        let (height, width) = map.dim();
        case.check("hidden_colour", &colour.into_shape_with_order((case.cameras.len(), 3, height, width)).unwrap());
        case.check("hidden_coverage", &coverage);
        case.check("seen", &seen.mapv(|any| if any { 1.0_f32 } else { 0.0 }));
    });
}

#[test]
fn exposure() {
    for_whole(|case| {
        let distances: Vec<f64> = case.cameras.iter().map(|camera| distance(camera, &case.target)).collect();
        let found = case.with_views(|views| exposure_gains(views, &distances));
        case.check("gains", &Array2::from_shape_fn((found.len(), 3), |(view, channel)| found[view][channel]));
    });
}

#[test]
fn sharpness() {
    for_whole(|case| {
        case.check("sharpening", &Array1::from_vec(case.with_views(sharpening)));
        for (index, &amount) in case.get::<f32>("sharpening").iter().enumerate() {
            case.check(&format!("sharpened{index}"), &stages::sharpened(case.view(index).texture, amount + 0.05));
        }
    });
}

/// Depth, confirmations and surface are the same bits whatever the threads.
#[test]
fn threads_change_no_bit() {
    for name in ["scene", "sizes"] {
        let case = Case::open(name);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let (near, far) = case.range;
                let depth = photo_depth(&case.view(0), &case.neighbours(0), near, far, &case.settings).disparity;
                let surface = case.with_views(|views| surface(views, &case.target, near, far, &case.settings));
                let gains = case.with_views(|views| exposure_gains(views, &vec![1.0; views.len()])).concat();
                let sharpening = case.with_views(sharpening);
                let all = depth.iter().chain(&surface.disparity).chain(&gains).chain(&sharpening);
                all.map(|value| value.to_bits()).collect::<Vec<_>>()
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(3), "{name}");
    }
}
