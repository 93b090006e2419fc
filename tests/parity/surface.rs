//! Depth of the photos and the target's surface, stage by stage.
//!
//! Elements that the last bits decide are marked doubtful by the oracle
//! (`liveview_ref/parity/surface_goldens.py`): they may be wrong, but only few are doubtful.

use liveview::geometry::distance;
use liveview::layers::Layer;
use liveview::render::{Visibility, VisibleView};
use liveview::surface::stages::{self, Search};
use liveview::surface::{
    ConsistencyVotes, PhotoDepth, anchored_depth, confirmed, exposure_gains, photo_depth, sharpening, surface,
};
use ndarray::{Array1, Array2, Axis};

use crate::golden::{assert_none, listed_cases};
use crate::surface_case::SurfaceCase;

const CASES: [&str; 12] = [
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
    "moving",
    "planes_4096",
];

/// Planes of the second search per plane of the first.
const FINE_PER_COARSE: usize = 2;
/// How much nearer a view's own depth must be to hide a point, pixels of parallax.
const OCCLUSION_MARGIN_PX: f32 = 4.0;
/// Number of layers along the surface, as many as `liveview_ref/parity/surface_stages.py` makes.
const LAYERS: usize = 3;
/// Offsets of the surface whose photo variance is compared, pixels of parallax; as there.
const OFFSETS: [f32; 7] = [1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -1.5];

/// Runs `check` on each of the cases, and reports their failures together.
fn for_cases(names: &[&'static str], check: impl Fn(&SurfaceCase)) {
    let failures = names.iter().flat_map(|name| {
        let case = SurfaceCase::open(name);
        check(&case);
        case.into_failures()
    });
    assert_none(&failures.collect::<Vec<_>>());
}

fn for_all(check: impl Fn(&SurfaceCase)) {
    for_cases(&CASES, check);
}

/// All cases but the last, which has the first search only.
fn for_photos(check: impl Fn(&SurfaceCase)) {
    for_cases(&CASES[..CASES.len() - 1], check);
}

/// The cases with stages at a target: not the one whose photos contradict each other.
fn for_complete(check: impl Fn(&SurfaceCase)) {
    for_cases(&CASES[..CASES.len() - 2], check);
}

#[test]
fn generated_cases_are_all_tested() {
    assert_eq!(listed_cases("surface_cases.txt"), CASES);
}

#[test]
fn half_resolution_search_is_within_bounds() {
    for_all(|case| {
        let search = Search { range: case.range, count: case.count, parts: 1, cell: 2, starts: None };
        let found = stages::matching_costs(&case.view(0), &case.neighbours(0), &search);
        case.check("half_costs", &found);
        let costs = case.volume::<u16>("half_costs");
        case.check("half_found", &stages::aggregated(&costs, &case.textures[0], &search));
        case.check("half_index", &stages::median3(&case.map("half_found")));
        let fine = (case.count - 1) * FINE_PER_COARSE + 1;
        case.check("starts", &stages::segment_starts(&case.map("half_index"), FINE_PER_COARSE, fine));
    });
}

#[test]
fn full_resolution_search_is_within_bounds() {
    for_photos(|case| {
        let starts = case.volume::<u16>("starts");
        let (range, count, parts) = (case.range, case.count, FINE_PER_COARSE);
        let search = Search { range, count, parts, cell: 1, starts: Some(&starts) };
        let mut found = stages::matching_costs(&case.view(0), &case.neighbours(0), &search);
        // The costs of a segment that a cell does not have are unspecified.
        let missing = |y: usize, x: usize| starts[(y / 2, x / 2, 1)] == u16::MAX;
        found.indexed_iter_mut().filter(|((y, x, k), _)| *k >= 8 && missing(*y, *x)).for_each(|(_, cost)| *cost = 0);
        case.check("fine_costs", &found);
        let costs = case.volume::<u16>("fine_costs");
        case.check("fine_found", &stages::aggregated(&costs, &case.textures[0], &search));
        case.check("fine_index", &stages::median3(&case.map("fine_found")));
    });
}

#[test]
fn photo_depth_is_within_bounds() {
    for_photos(|case| {
        for which in 0..case.cameras.len() {
            let neighbours = case.neighbours(which);
            let found = photo_depth(&case.view(which), &neighbours, case.range.0, case.range.1);
            case.check(&format!("depth{which}"), &found.disparity);
            let pixel = case.get::<f32>("pixel")[[which]];
            assert!(
                (found.disparity_per_pixel / pixel - 1.0).abs() < 3e-7,
                "{}: disparity per pixel {}, expected {pixel}",
                case.name,
                found.disparity_per_pixel
            );
        }
    });
}

#[test]
fn anchored_depth_and_its_stages_are_within_bounds() {
    for_photos(|case| {
        let neighbours = case.neighbours(0);
        let views: Vec<_> = std::iter::once(case.view(0)).chain(neighbours.iter().copied()).collect();
        for (which, map) in stages::group(&views, case.range).iter().enumerate() {
            case.check(&format!("coarse{which}"), &map.disparity);
        }
        let cameras: Vec<_> = views.iter().map(|view| view.camera).collect();
        let (maps, confirmed) = case.group(views.len());
        for (which, sure) in stages::group_confirmed(&cameras, &maps).iter().enumerate() {
            let sure = sure.disparity.mapv(|disparity| if disparity >= 0.0 { 1.0_f32 } else { 0.0 });
            case.check(&format!("coarse_sure{which}"), &sure);
        }
        let search = Search { range: case.range, count: case.count, parts: 1, cell: 2, starts: None };
        let half = stages::disparity(&case.map("half_index"), &search);
        let half = PhotoDepth { disparity: half, disparity_per_pixel: case.get::<f32>("pixel")[[0]] };
        let (kept, anchor) = stages::anchors(&cameras, &maps, confirmed, &half);
        case.check("kept", &kept.mapv(|kept| if kept { 1.0_f32 } else { 0.0 }));
        case.check("anchor", &anchor);
        let (kept, anchor) = (case.map("kept").mapv(|kept| kept > 0.0), case.map("anchor"));
        case.check("anchored_costs", &stages::anchored_costs(&case.volume("half_costs"), kept, &anchor, &search));
        case.check("anchored", &anchored_depth(&views[0], &neighbours, case.range.0, case.range.1).disparity);
    });
}

#[test]
fn confirmed_is_within_bounds() {
    for_complete(|case| {
        let depths = case.depths();
        let maps: Vec<_> = case.cameras.iter().zip(&depths).collect();
        for which in 0..maps.len() {
            let others = (0..maps.len()).filter(|&other| other != which);
            let votes: Vec<_> = others.map(|other| ConsistencyVotes::new(maps[which], maps[other])).collect();
            let found = confirmed(&votes.iter().collect::<Vec<_>>(), depths[which].disparity.dim());
            case.check(&format!("confirmed{which}"), &found.mapv(|yes| if yes { 1.0_f32 } else { 0.0 }));
        }
    });
}

#[test]
fn range_of_confirmed_disparities_is_within_bounds() {
    for_complete(|case| {
        let depths = case.depths();
        let kept = depths.iter().enumerate().flat_map(|(which, depth)| {
            let confirmed = case.map(&format!("confirmed{which}"));
            depth.disparity.iter().zip(&confirmed).filter(|(_, yes)| **yes > 0.0).map(|(d, _)| *d).collect::<Vec<_>>()
        });
        let found =
            stages::range_of(kept.collect(), case.range).map_or([-1.0, -1.0], |(near, far)| [1.0 / near, 1.0 / far]);
        case.check("found_range", &ndarray::arr1(&found.map(|disparity| disparity as f32)));
    });
}

#[test]
fn splat_holes_and_visibility_are_within_bounds() {
    for_complete(|case| {
        let disparity_per_pixel = case.disparity_per_pixel();
        case.with_views(|views| {
            case.check("splat", &stages::splatted(views, &case.target, disparity_per_pixel));
            case.check("filled", &stages::fill_holes(&case.map("splat")));
            let (map, margin) = (case.map("filled"), OCCLUSION_MARGIN_PX * disparity_per_pixel);
            let maps = views.iter().map(|v| (v.view.camera, v.confirmed));
            let seen: Vec<_> = maps.map(|view| stages::visible(view, &case.target, &map, margin)).collect();
            let seen: Vec<_> = seen.iter().map(|map| map.view()).collect();
            case.check("visible", &ndarray::stack(Axis(0), &seen).unwrap());
        });
    });
}

#[test]
fn photo_variance_is_within_bounds() {
    for_complete(|case| {
        let ((sources, visible), map, pixel) = (case.at_target(), case.map("filled"), case.disparity_per_pixel());
        let moved = |offset: f32| map.mapv(|disparity| (disparity + offset * pixel).max(0.0));
        let found = OFFSETS.map(|offset| stages::photo_variance(&sources, &visible, &moved(offset)));
        case.check("photo_variance", &ndarray::stack(Axis(0), &found.each_ref().map(|map| map.view())).unwrap());
    });
}

#[test]
fn surface_and_layers_are_within_bounds() {
    for_complete(|case| {
        let ((near, far), target) = (case.range, &case.target);
        let found = case.with_views(|views| surface(views, target, near, far));
        case.check("surface", &found.disparity);
        let layers = found.layers(LAYERS).unwrap();
        let map = |layer: &Layer| if let Layer::Pixels(map) = layer { map.clone() } else { panic!("not by pixel") };
        let maps: Vec<_> = layers.as_slice().iter().map(map).collect();
        case.check("layers", &ndarray::stack(Axis(0), &maps.iter().map(|m| m.view()).collect::<Vec<_>>()).unwrap());
    });
}

#[test]
fn occluded_samples_are_within_bounds() {
    for_complete(|case| {
        let (map, pixel) = (case.map("filled"), case.disparity_per_pixel());
        let (colour, coverage, seen) = case.with_views(|views| {
            let seen = views.iter().map(|v| VisibleView {
                disparity: &v.confirmed.disparity,
                gains: v.gains,
                sharpening: 0.0,
            });
            let visibility = Visibility { views: seen.collect(), margin: OCCLUSION_MARGIN_PX * pixel, is_seen: true };
            let views: Vec<_> = views.iter().map(|v| v.view).collect();
            stages::occluded(&visibility, &views, &case.target, &map)
        });
        let (height, width) = map.dim();
        case.check("hidden_colour", &colour.into_shape_with_order((case.cameras.len(), 3, height, width)).unwrap());
        case.check("hidden_coverage", &coverage);
        case.check("seen", &seen.mapv(|any| if any { 1.0_f32 } else { 0.0 }));
    });
}

#[test]
fn exposure_gains_are_within_bounds() {
    for_complete(|case| {
        let distances: Vec<f64> = case.cameras.iter().map(|camera| distance(camera, &case.target)).collect();
        let found = case.with_views(|views| exposure_gains(views, &distances));
        case.check("gains", &Array2::from_shape_fn((found.len(), 3), |(view, channel)| found[view][channel]));
    });
}

#[test]
fn sharpening_is_within_bounds() {
    for_complete(|case| {
        case.check("sharpening", &Array1::from_vec(case.with_views(sharpening)));
        for (index, &amount) in case.get::<f32>("sharpening").iter().enumerate() {
            case.check(&format!("sharpened{index}"), &stages::sharpened(case.view(index).texture, amount + 0.05));
        }
    });
}

/// Depth, surface, gains and sharpening.
#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for name in ["scene", "sizes"] {
        let case = SurfaceCase::open(name);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let (near, far) = case.range;
                let depth = anchored_depth(&case.view(0), &case.neighbours(0), near, far).disparity;
                let surface = case.with_views(|views| surface(views, &case.target, near, far));
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
