//! Selection among planes by the histogram of the best planes of all pixels.

use liveview::layers::select_planes as fullest_planes;
use liveview::network::Alpha;

/// Indices, near → far, of the `count` planes to keep, given the histogram of best planes
/// ([`liveview::layers::plane_histogram`]): the paper's choice ([`liveview::layers::select_planes`]), or where
/// planes compete [`cover_planes`].
pub fn select_planes(alpha: Alpha, histogram: &[u64], count: usize) -> Vec<usize> {
    match alpha {
        Alpha::Competing { .. } => cover_planes(histogram, count),
        _ => fullest_planes(histogram, count),
    }
}

/// Selection among competing planes, not in the paper: the `count` planes that minimise the sum, over all pixels, of the distance from the best plane
/// of the pixel to the nearest selected plane; distances are counted in planes. Returns indices,
/// near → far.
///
/// Weighted k-medians of the histogram, exact by dynamic programming over the filled bins (ties:
/// the nearer). Selecting the fullest bins instead crowds planes at the most frequent depth and
/// leaves other depths without one. If no more than `count` bins are filled, as [`liveview::layers::select_planes`].
pub fn cover_planes(histogram: &[u64], count: usize) -> Vec<usize> {
    let bins: Vec<usize> = (0..histogram.len()).filter(|&k| histogram[k] > 0).collect();
    if bins.len() <= count || count == 0 {
        return fullest_planes(histogram, count);
    }
    let place = |b: usize| bins[b] as u64;
    let (mut total, mut moment) = (vec![0], vec![0]); // Σ pixels and Σ pixels · place of the bins before
    for b in 0..bins.len() {
        total.push(total[b] + histogram[bins[b]]);
        moment.push(moment[b] + histogram[bins[b]] * place(b));
    }
    // Sums of distances: of the bins from `start` up to a selected one, of those after it, and of
    // those between two selected ones.
    let before =
        |start: usize, kept: usize| place(kept) * (total[kept] - total[start]) - (moment[kept] - moment[start]);
    let after = |kept: usize, end: usize| moment[end] - moment[kept] - place(kept) * (total[end] - total[kept]);
    let between = |a: usize, b: usize| {
        let middle = bins.partition_point(|&bin| bin <= usize::midpoint(bins[a], bins[b]));
        after(a, middle) + before(middle, b)
    };
    // least[b]: the least sum over the bins up to b if b is selected, with one more bin selected
    // than there are rows in `last`; a row holds for each b the bin that was selected before it.
    let mut least: Vec<u64> = (0..bins.len()).map(|b| before(0, b)).collect();
    let mut last: Vec<Vec<usize>> = Vec::new();
    for selected in 1..count {
        let best = |b: usize| (selected - 1..b).map(|a| (least[a] + between(a, b), a)).min().unwrap_or((0, 0)); // never used
        let row: Vec<(u64, usize)> = (0..bins.len()).map(best).collect();
        last.push(row.iter().map(|&(_, a)| a).collect());
        least = row.into_iter().map(|(cost, _)| cost).collect();
    }
    let ends = (count - 1..bins.len()).min_by_key(|&b| least[b] + after(b, bins.len()));
    let mut chosen: Vec<usize> = ends.into_iter().collect();
    for row in last.iter().rev() {
        chosen.push(row[chosen[chosen.len() - 1]]);
    }
    chosen.into_iter().rev().map(|b| bins[b]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loss(histogram: &[u64], selected: &[usize]) -> u64 {
        let nearest = |k: usize| selected.iter().map(|&plane| plane.abs_diff(k)).min().unwrap() as u64;
        (0..histogram.len()).map(|k| histogram[k] * nearest(k)).sum()
    }

    #[test]
    fn selected_planes_cover_depths_that_the_fullest_bins_miss() {
        let histogram = [40, 50, 45, 0, 0, 0, 0, 9, 8, 0];
        assert_eq!(fullest_planes(&histogram, 2), [1, 2]);
        assert_eq!(cover_planes(&histogram, 2), [1, 7]);
        assert_eq!(cover_planes(&histogram, 5), [0, 1, 2, 7, 8]);
        assert_eq!(cover_planes(&histogram, 6), fullest_planes(&histogram, 6));
        assert_eq!(cover_planes(&[0; 4], 2), [0, 1]);
        assert_eq!(cover_planes(&histogram, 0), [0; 0]);
    }

    #[test]
    fn selected_planes_are_an_optimum_of_all_choices() {
        let mut state = 1u64;
        for case in 0..60 {
            let planes = 3 + case % 8;
            let histogram: Vec<u64> = (0..planes)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    (state >> 60).saturating_sub(4)
                })
                .collect();
            for count in 1..planes {
                let found = cover_planes(&histogram, count);
                assert!(found.len() == count && found.is_sorted_by(|a, b| a < b), "{found:?}");
                let choices = (0u32..1 << planes).filter(|bits| bits.count_ones() as usize == count);
                let kept = |bits: u32| (0..planes).filter(|k| bits >> k & 1 == 1).collect::<Vec<_>>();
                let least = choices.map(|bits| loss(&histogram, &kept(bits))).min().unwrap();
                assert_eq!(loss(&histogram, &found), least, "{histogram:?}, {count}: {found:?}");
            }
        }
    }
}
