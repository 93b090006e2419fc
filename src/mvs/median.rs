//! The median of each cell's 3×3 neighbourhood, edges held.

use rayon::prelude::*;

/// Of a map `[h, w]` of rows `width` wide.
pub(super) fn median3(map: &[f32], width: usize) -> Vec<f32> {
    let height = map.len() / width;
    let mut out = vec![0.0; map.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let row = |y: usize| &map[y * width..(y + 1) * width];
        median_row([row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))], out);
    });
    out
}

#[pulp::with_simd(median_row = crate::simd::arch())]
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

/// Paeth's network: the extremes fall away, two at a time.
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
    // The greatest of the least, the middle of the middle, the least of the greatest; of these the middle.
    let [_, middle, _] = sort([high(high(a, d), g), sort([b, e, h])[1], low(low(c, f), i)]);
    middle
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_fifth_of_nine_sorted() {
        let (width, height) = (7, 5);
        let map: Vec<f32> = (0..width * height).map(|i| ((i * 37) % 23) as f32).collect();
        let found = median3(&map, width);
        for y in 0..height {
            for x in 0..width {
                let near = |at: usize, by: usize, last: usize| (at + by).saturating_sub(1).min(last);
                let value = |k: usize| map[near(y, k / 3, height - 1) * width + near(x, k % 3, width - 1)];
                let mut nine: Vec<f32> = (0..9).map(value).collect();
                nine.sort_by(f32::total_cmp);
                assert_eq!(found[y * width + x], nine[4], "row {y}, column {x}");
            }
        }
    }

    #[test]
    fn a_row_or_a_column_alone_is_its_own_neighbourhood() {
        assert_eq!(median3(&[3.0, 1.0, 2.0], 3), [3.0, 2.0, 2.0]);
        assert_eq!(median3(&[3.0, 1.0, 2.0], 1), [3.0, 2.0, 2.0]);
        assert_eq!(median3(&[5.0], 1), [5.0]);
    }
}
