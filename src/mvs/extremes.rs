//! The largest and the smallest of each cell's 3×3 neighbourhood, edges held.

use rayon::prelude::*;

/// Of a map `[h, w]` of rows `width` wide: the largest, the smallest.
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

/// Down the columns first (with one more at either end), then along the row.
#[pulp::with_simd(extremes_row = crate::simd::arch())]
#[inline(always)]
fn extremes_row_with<'a, S: pulp::Simd>(
    _simd: S,
    [above, here, below]: [&'a [f32]; 3],
    [most, least]: &'a mut [Vec<f32>; 2],
    largest: &'a mut [f32],
    smallest: &'a mut [f32],
) {
    let width = largest.len();
    let (above, here, below, smallest) = (&above[..width], &here[..width], &below[..width], &mut smallest[..width]);
    let high = |a: f32, b: f32| if a > b { a } else { b };
    let low = |a: f32, b: f32| if a < b { a } else { b };
    for (x, most) in most[1..=width].iter_mut().enumerate() {
        *most = high(high(above[x], here[x]), below[x]);
    }
    for (x, least) in least[1..=width].iter_mut().enumerate() {
        *least = low(low(above[x], here[x]), below[x]);
    }
    for columns in [&mut *most, least] {
        (columns[0], columns[width + 1]) = (columns[1], columns[width]);
    }
    let (most, least) = (&most[..width + 2], &least[..width + 2]);
    for x in 0..width {
        largest[x] = high(high(most[x], most[x + 1]), most[x + 2]);
        smallest[x] = low(low(least[x], least[x + 1]), least[x + 2]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_those_of_nine() {
        let (width, height) = (11, 5);
        let map: Vec<f32> = (0..width * height).map(|i| ((i * 37) % 23) as f32).collect();
        let (largest, smallest) = extremes3(&map, width);
        for y in 0..height {
            for x in 0..width {
                let near = |at: usize, by: usize, last: usize| (at + by).saturating_sub(1).min(last);
                let value = |k: usize| map[near(y, k / 3, height - 1) * width + near(x, k % 3, width - 1)];
                let nine = || (0..9).map(value);
                let at = y * width + x;
                assert_eq!(largest[at], nine().fold(f32::MIN, f32::max), "row {y}, column {x}");
                assert_eq!(smallest[at], nine().fold(f32::MAX, f32::min), "row {y}, column {x}");
            }
        }
        assert_eq!(extremes3(&[3.0], 1), (vec![3.0], vec![3.0]));
    }
}
