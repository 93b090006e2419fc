//! Planes at the disparities of the scene: 1-D k-means over the disparities that the guided search finds. Unlike the paper's
//! selection, the planes are not taken from a fixed list.

/// Bins of the histogram that k-means runs over: far finer than the planes' spacing.
const BINS: usize = 512;

/// The `count` planes (1/scene unit, near → far) whose sum of squared distances to the `disparities` (1/scene unit) is least: 1-D
/// k-means, exact over a histogram of 512 bins (dynamic programming over where each cluster begins: Ckmeans.1d.dp, Wang and Song,
/// 2011). Fewer where fewer bins hold anything; values that are not finite are left out.
pub fn kmeans_planes(disparities: &[f32], count: usize) -> Vec<f64> {
    let known = || disparities.iter().copied().filter(|d| d.is_finite()).map(f64::from);
    let (low, high) = known().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), d| (low.min(d), high.max(d)));
    let mut bins = [[0.0; 3]; BINS]; // of the values x in each bin: Σ 1, Σ x, Σ x²
    for disparity in known() {
        let part = if high > low { (disparity - low) / (high - low) } else { 0.0 };
        let bin = &mut bins[((part * BINS as f64) as usize).min(BINS - 1)];
        // Relative to `low`, which keeps the sums of squares small.
        let x = disparity - low;
        [1.0, x, x * x].into_iter().zip(bin).for_each(|(term, sum)| *sum += term);
    }
    let mut sums = vec![[0.0; 3]];
    for bin in bins.iter().filter(|bin| bin[0] > 0.0) {
        let before = sums[sums.len() - 1];
        sums.push(std::array::from_fn(|i| before[i] + bin[i]));
    }
    let filled = sums.len() - 1;
    let moments = |from: usize, to: usize| std::array::from_fn(|i| sums[to][i] - sums[from][i]);
    let spread = |from: usize, to: usize| {
        let [weight, x, squares]: [f64; 3] = moments(from, to);
        (squares - x * x / weight).max(0.0)
    };
    // least[to]: the least sum of squares of the first `to` bins in as many clusters as there are rows in `begins`; a row says for
    // each `to` where the last of these clusters begins.
    let mut least: Vec<f64> = (0..=filled).map(|to| if to == 0 { 0.0 } else { spread(0, to) }).collect();
    let mut begins = vec![vec![0; filled + 1]];
    for clusters in 1..count.min(filled) {
        let best = |to: usize| {
            let candidates = (clusters..to).map(|from| (least[from] + spread(from, to), from));
            candidates.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, 0))
        };
        let row: Vec<(f64, usize)> = (0..=filled).map(best).collect();
        begins.push(row.iter().map(|&(_, from)| from).collect());
        least = row.into_iter().map(|(cost, _)| cost).collect();
    }
    let mut to = filled;
    let clusters = begins.iter().rev().filter(|_| filled > 0);
    let planes = clusters.map(|begins| {
        let [weight, x, _]: [f64; 3] = moments(begins[to], to);
        to = begins[to];
        low + x / weight
    });
    planes.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kmeans_finds_clusters_of_unequal_size_and_bears_odd_input() {
        let mut disparities = vec![0.1; 1000];
        disparities.extend([0.5, 0.5, 0.52, 0.9, f32::NAN]);
        let planes = kmeans_planes(&disparities, 3);
        let expected = [0.9, (0.5 + 0.5 + 0.52) / 3.0, 0.1];
        assert!(planes.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{planes:?}");
        assert_eq!(kmeans_planes(&disparities, 1).len(), 1);
        assert_eq!(kmeans_planes(&[0.25; 9], 4), [0.25]);
        assert_eq!(kmeans_planes(&[], 4), [0.0; 0]);
    }

    #[test]
    fn kmeans_is_no_worse_than_uniform_planes() {
        let disparities: Vec<f32> = (0..4000).map(|i| (i as f32 / 4000.0).powi(3)).collect();
        let loss = |planes: &[f64]| -> f64 {
            let nearest = |d: f64| planes.iter().map(|p| (p - d).powi(2)).fold(f64::INFINITY, f64::min);
            disparities.iter().map(|&d| nearest(d.into())).sum()
        };
        for count in [2, 5, 16] {
            let uniform: Vec<f64> = (0..count).map(|k| (k as f64 + 0.5) / count as f64).collect();
            let planes = kmeans_planes(&disparities, count);
            assert!(planes.len() == count && planes.is_sorted_by(|a, b| a > b), "{planes:?}");
            assert!(loss(&planes) < 0.7 * loss(&uniform), "{count}: {} of {}", loss(&planes), loss(&uniform));
        }
    }
}
