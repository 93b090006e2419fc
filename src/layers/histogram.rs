//! The paper's plane selection: the K fullest bins of the histogram of per-pixel best planes
//! (section "Plane selection").

/// For each plane, the number of pixels of which it is the best. `best` holds for each pixel the
/// index of the plane with the largest α; `None`, where all α are 0, is not counted.
///
/// # Panics
///
/// If an index is not below `planes`.
pub fn plane_histogram(best: impl IntoIterator<Item = Option<usize>>, planes: usize) -> Vec<u64> {
    let mut bins = vec![0; planes];
    for plane in best.into_iter().flatten() {
        bins[plane] += 1;
    }
    bins
}

/// Indices of the `count` fullest bins (ties: the nearer), near → far; all planes if there are no
/// more than that.
pub fn select_planes(histogram: &[u64], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..histogram.len()).collect();
    order.sort_by_key(|&k| (std::cmp::Reverse(histogram[k]), k));
    order.truncate(count);
    order.sort_unstable();
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fullest_bins_are_selected_and_ties_go_to_the_nearer() {
        let bins = plane_histogram([Some(3), Some(1), Some(2), Some(3), None], 5);
        assert_eq!(bins, [0, 1, 1, 2, 0]);
        assert_eq!(select_planes(&bins, 2), [1, 3]);
        assert_eq!(select_planes(&bins, 9), [0, 1, 2, 3, 4]);
    }
}
