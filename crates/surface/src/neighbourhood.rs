//! Maps filtered over each pixel's neighbourhood: median and extremes of 3×3 pixels, edges clamped;
//! the share of known values of a window; and holes filled ring by ring.

use ndarray::Array2;
use rayon::prelude::*;

/// Median of each 3×3 neighbourhood of a map with rows `width` wide.
pub(super) fn median3(map: &[f32], width: usize) -> Vec<f32> {
    let height = map.len() / width;
    let mut out = vec![0.0; map.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let row = |y: usize| &map[y * width..(y + 1) * width];
        median_row([row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))], out);
    });
    out
}

#[pulp::with_simd(median_row = liveview::simd::arch())]
#[inline(always)]
fn median_row_with<'a, S: pulp::Simd>(_simd: S, rows: [&'a [f32]; 3], out: &'a mut [f32]) {
    let last = out.len() - 1;
    let at = |x: usize| {
        let columns = [x.saturating_sub(1), x, (x + 1).min(last)];
        median(std::array::from_fn(|k| rows[k / 3][columns[k % 3]]))
    };
    (out[0], out[last]) = (at(0), at(last));
    if last < 2 {
        return;
    }
    let [above, here, below] = rows;
    let inner = &mut out[1..last];
    let shifted = |row: &'a [f32]| -> [&'a [f32]; 3] { std::array::from_fn(|i| &row[i..i + last - 1]) };
    let (above, here, below) = (shifted(above), shifted(here), shifted(below));
    for x in 0..inner.len() {
        let row = |row: &[&[f32]; 3]| [row[0][x], row[1][x], row[2][x]];
        let ([a, b, c], [d, e, f], [g, h, i]) = (row(&above), row(&here), row(&below));
        inner[x] = median([a, b, c, d, e, f, g, h, i]);
    }
}

/// Median of nine by Paeth's network, which discards the extremes two at a time.
#[inline(always)]
fn median(values: [f32; 9]) -> f32 {
    let low = |a: f32, b: f32| if a < b { a } else { b };
    let high = |a: f32, b: f32| if a < b { b } else { a };
    let sort = |[a, b, c]: [f32; 3]| {
        let (a, b) = (low(a, b), high(a, b));
        let (b, c) = (low(b, c), high(b, c));
        [low(a, b), high(a, b), c]
    };
    let [a, b, c, d, e, f, g, h, i] = values;
    let ([a, b, c], [d, e, f], [g, h, i]) = (sort([a, b, c]), sort([d, e, f]), sort([g, h, i]));
    // The maximum of the minima, the median of the medians, the minimum of the maxima; their
    // median.
    let [_, middle, _] = sort([high(high(a, d), g), sort([b, e, h])[1], low(low(c, f), i)]);
    middle
}

/// Largest and smallest value of each 3×3 neighbourhood of a map with rows `width` wide.
pub(super) fn extremes3(map: &[f32], width: usize) -> (Vec<f32>, Vec<f32>) {
    let height = map.len() / width;
    let (mut largest, mut smallest) = (vec![0.0; map.len()], vec![0.0; map.len()]);
    let lines = largest.par_chunks_mut(width).zip(smallest.par_chunks_mut(width)).enumerate();
    lines.for_each_init(
        || [vec![0.0; width + 2], vec![0.0; width + 2]],
        |columns, (y, (largest, smallest))| {
            let row = |y: usize| &map[y * width..(y + 1) * width];
            let rows = [row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))];
            extremes_row(rows, columns, largest, smallest);
        },
    );
    (largest, smallest)
}

/// Down the columns first (with one more column at either end), then along the row.
#[pulp::with_simd(extremes_row = liveview::simd::arch())]
#[inline(always)]
fn extremes_row_with<'a, S: pulp::Simd>(
    _simd: S,
    [above, here, below]: [&'a [f32]; 3],
    [highest, lowest]: &'a mut [Vec<f32>; 2],
    largest: &'a mut [f32],
    smallest: &'a mut [f32],
) {
    let width = largest.len();
    let (above, here, below, smallest) = (&above[..width], &here[..width], &below[..width], &mut smallest[..width]);
    let high = |a: f32, b: f32| if a > b { a } else { b };
    let low = |a: f32, b: f32| if a < b { a } else { b };
    for (x, highest) in highest[1..=width].iter_mut().enumerate() {
        *highest = high(high(above[x], here[x]), below[x]);
    }
    for (x, lowest) in lowest[1..=width].iter_mut().enumerate() {
        *lowest = low(low(above[x], here[x]), below[x]);
    }
    for columns in [&mut *highest, lowest] {
        (columns[0], columns[width + 1]) = (columns[1], columns[width]);
    }
    let (highest, lowest) = (&highest[..width + 2], &lowest[..width + 2]);
    for x in 0..width {
        largest[x] = high(high(highest[x], highest[x + 1]), highest[x + 2]);
        smallest[x] = low(low(lowest[x], lowest[x + 1]), lowest[x + 2]);
    }
}

/// Share (0 to 1) of the values that are 0 or more within `radius` pixels of a (row, column) in either
/// direction, by sums over rectangles.
pub(super) fn share_of_known(map: &Array2<f32>, radius: usize) -> impl Fn((usize, usize)) -> f32 + Sync {
    let (height, width) = map.dim();
    let mut sums = Array2::<u32>::zeros((height + 1, width + 1));
    for ((y, x), &value) in map.indexed_iter() {
        let count = u32::from(value >= 0.0);
        sums[(y + 1, x + 1)] = count + sums[(y, x + 1)] + sums[(y + 1, x)] - sums[(y, x)];
    }
    move |(y, x)| {
        let (top, bottom) = (y.saturating_sub(radius), (y + radius + 1).min(height));
        let (left, right) = (x.saturating_sub(radius), (x + radius + 1).min(width));
        let count = sums[(bottom, right)] + sums[(top, left)] - sums[(top, right)] - sums[(bottom, left)];
        count as f32 / ((bottom - top) * (right - left)) as f32
    }
}

/// Fills holes (values below 0) with the smallest of their 8 neighbours that are no holes: one ring
/// of holes after another. A map without values becomes 0. Takes time in proportion to the map.
pub(super) fn fill_holes(map: &[f32], width: usize) -> Vec<f32> {
    let height = map.len() / width;
    let neighbours = |at: usize| {
        let (y, x) = (at / width, at % width);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        (y.saturating_sub(1)..(y + 2).min(height)).flat_map(move |row| columns.clone().map(move |x| row * width + x))
    };
    let mut map = map.to_vec();
    if map.iter().all(|&value| value < 0.0) {
        return vec![0.0; map.len()];
    }
    // The holes of the next ring, each once.
    let mut queued = vec![false; map.len()];
    let borders_value = |&at: &usize| map[at] < 0.0 && neighbours(at).any(|other| map[other] >= 0.0);
    let mut ring: Vec<usize> = (0..map.len()).filter(borders_value).collect();
    ring.iter().for_each(|&at| queued[at] = true);
    while !ring.is_empty() {
        let smallest = |&at: &usize| {
            neighbours(at).map(|other| map[other]).filter(|&value| value >= 0.0).fold(f32::INFINITY, f32::min)
        };
        let values: Vec<f32> = ring.iter().map(smallest).collect();
        ring.iter().zip(values).for_each(|(&at, value)| map[at] = value);
        let mut next = Vec::new();
        for other in ring.iter().flat_map(|&at| neighbours(at)) {
            if map[other] < 0.0 && !queued[other] {
                queued[other] = true;
                next.push(other);
            }
        }
        ring = next;
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median3_is_the_fifth_of_nine_sorted_values() {
        let (width, height) = (7, 5);
        let map: Vec<f32> = (0..width * height).map(|i| ((i * 37) % 23) as f32).collect();
        let found = median3(&map, width);
        for y in 0..height {
            for x in 0..width {
                let clamped = |at: usize, by: usize, last: usize| (at + by).saturating_sub(1).min(last);
                let value = |k: usize| map[clamped(y, k / 3, height - 1) * width + clamped(x, k % 3, width - 1)];
                let mut nine: Vec<f32> = (0..9).map(value).collect();
                nine.sort_by(f32::total_cmp);
                assert_eq!(found[y * width + x], nine[4], "row {y}, column {x}");
            }
        }
    }

    #[test]
    fn median3_single_row_or_column_clamps_its_edges() {
        assert_eq!(median3(&[3.0, 1.0, 2.0], 3), [3.0, 2.0, 2.0]);
        assert_eq!(median3(&[3.0, 1.0, 2.0], 1), [3.0, 2.0, 2.0]);
        assert_eq!(median3(&[5.0], 1), [5.0]);
    }

    #[test]
    fn extremes3_are_the_extremes_of_nine_values() {
        let (width, height) = (11, 5);
        let map: Vec<f32> = (0..width * height).map(|i| ((i * 37) % 23) as f32).collect();
        let (largest, smallest) = extremes3(&map, width);
        for y in 0..height {
            for x in 0..width {
                let clamped = |at: usize, by: usize, last: usize| (at + by).saturating_sub(1).min(last);
                let value = |k: usize| map[clamped(y, k / 3, height - 1) * width + clamped(x, k % 3, width - 1)];
                let nine = || (0..9).map(value);
                let at = y * width + x;
                assert_eq!(largest[at], nine().fold(f32::MIN, f32::max), "row {y}, column {x}");
                assert_eq!(smallest[at], nine().fold(f32::MAX, f32::min), "row {y}, column {x}");
            }
        }
        assert_eq!(extremes3(&[3.0], 1), (vec![3.0], vec![3.0]));
    }

    #[test]
    fn fill_holes_between_near_and_far_gives_far() {
        let map = [2.0, -1.0, -1.0, -1.0, -1.0, 1.0];
        assert_eq!(fill_holes(&map, 6), [2.0, 2.0, 2.0, 1.0, 1.0, 1.0]);
        assert_eq!(fill_holes(&[2.0, -1.0, 1.0], 3), [2.0, 1.0, 1.0]);
        assert_eq!(fill_holes(&[-1.0; 4], 2), [0.0; 4]);
    }

    #[test]
    fn fill_holes_takes_time_in_proportion_to_the_map() {
        // A row whose only value is at its end has as many rings as pixels: a scan of all holes for
        // each ring would take hours.
        let mut map = vec![-1.0; 1 << 22];
        map[0] = 1.0;
        assert!(fill_holes(&map, 1 << 22).iter().all(|&value| value == 1.0));
    }

    #[test]
    fn fill_holes_zero_disparity_is_a_value() {
        assert_eq!(fill_holes(&[0.0, -1.0, 1.0], 3), [0.0, 0.0, 1.0]);
    }
}
