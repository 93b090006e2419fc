//! The search for guided layers.

use liveview::layers::guided::{
    COARSE, GuidedSearch, WINDOWS, fine_layers, layer_costs, range_of, semi_global, winner_takes_all,
};
use liveview::layers::{CELL, Layer};
use liveview::warp::warp_sources;
use ndarray::{Array3, Axis};

use crate::golden::flat;
use crate::stage_case::for_all;

/// Depth range of the generated cases, in scene units.
const NEAR: f64 = 1.0;
const FAR: f64 = 8.0;

#[test]
fn guided_search_is_within_bounds() {
    for_all(|case| {
        let Some(disparities) = case.find::<f64>("coarse_disparities") else { return };
        let [costs, aggregated, layers, fine_costs] =
            ["costs", "aggregated_costs", "fine_layers", "fine_costs"].map(|name| case.volume::<f32>(name));
        let views = case.views();
        let sources = warp_sources(&views, &case.target);
        let planes = Array3::from_shape_fn(costs.dim(), |(plane, _, _)| disparities[[plane]] as f32);
        case.check("costs", &layer_costs(&sources, planes.view(), COARSE, WINDOWS[0]));
        case.check("aggregated_costs", &semi_global(costs.view()));
        case.check("coarse_disparity", &winner_takes_all(aggregated.view(), planes.view()));
        let coarse = case.map("coarse_disparity");
        let margin = ((disparities[[0]] - disparities[[1]]) / 2.0) as f32;
        case.check("fine_layers", &fine_layers(&range_of(&coarse, margin)));
        case.check("fine_costs", &layer_costs(&sources, layers.view(), CELL, WINDOWS[1]));
        case.check("fine_disparity", &winner_takes_all(fine_costs.view(), layers.view()));
        let fine = case.map("fine_disparity");
        let range = range_of(&fine, 0.0);
        let maps = [range.nearest(), range.surface(), range.farthest()].map(|map| map.view());
        case.check("range", &ndarray::stack(Axis(0), &maps).unwrap());
        let layers = range.layers(case.layers().len()).unwrap();
        let map = |layer: &Layer| if let Layer::Map(map) = layer { map.clone() } else { unreachable!("guided layers") };
        let maps: Vec<_> = layers.as_slice().iter().map(map).collect();
        case.check("cell_maps", &ndarray::stack(Axis(0), &maps.iter().map(|m| m.view()).collect::<Vec<_>>()).unwrap());

        let found = GuidedSearch::new(NEAR, FAR).search(&sources, case.padded()).unwrap();
        assert_eq!(found.disparities, flat(disparities), "{}: planes searched", case.name);
    });
}
