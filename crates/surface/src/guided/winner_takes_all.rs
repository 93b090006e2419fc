//! Winner takes all: the disparity of least cost at each cell.

use ndarray::{Array2, ArrayView3, Axis};

/// Disparity `[h, w]` of the layer of least cost at each cell (ties: the nearer). Except at the
/// first and the last layer it is refined to the vertex of the parabola through the cost of the
/// layer and the costs of its two neighbours. `costs` and the layers' disparities `maps` (1/scene
/// unit) are `[D, h, w]`.
///
/// # Panics
///
/// If there are no layers, or the shapes differ.
pub fn winner_takes_all(costs: ArrayView3<'_, f32>, maps: ArrayView3<'_, f32>) -> Array2<f32> {
    let (layers, height, width) = costs.dim();
    let mut best = Array2::<u32>::zeros((height, width));
    let mut least = costs.index_axis(Axis(0), 0).to_owned();
    for (layer, cost) in costs.outer_iter().enumerate().skip(1) {
        ndarray::Zip::from(&mut best).and(&mut least).and(cost).for_each(|best, least, &cost| {
            if cost < *least {
                (*best, *least) = (layer as u32, cost);
            }
        });
    }
    Array2::from_shape_fn((height, width), |(y, x)| {
        let k = best[(y, x)] as usize;
        if k == 0 || k + 1 == layers {
            return maps[(k, y, x)];
        }
        let [nearer, here, farther] = [k - 1, k, k + 1].map(|k| f64::from(costs[(k, y, x)]));
        let curvature = nearer - 2.0 * here + farther;
        let shift = if curvature > 0.0 { 0.5 * (nearer - farther) / curvature } else { 0.0 };
        let towards = if shift > 0.0 { k + 1 } else { k - 1 };
        let [own, towards] = [k, towards].map(|k| f64::from(maps[(k, y, x)]));
        (own + shift.abs() * (towards - own)) as f32
    })
}
