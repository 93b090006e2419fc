//! How large the finest detail of a photo is: an enlarged or soft photo has none of one pixel, and a
//! search at its full size costs more and finds less.
//!
//! The detail of a size is the mean square, over the inner pixels, of 4 times a pixel's grey (the mean
//! of its channels) less its four neighbours. While a photo's detail is below 0.22 of that of the photo
//! at half its size (area averages), the smaller one takes its place, as long as its shorter side has
//! 240 pixels. Photos as cameras took them have 0.27 to 1.0 (median of each of 46 scenes but two), the
//! same enlarged twice 0.12 to 0.20.

use super::planes::Planes;
use liveview::warp::Texture;

/// Share of the detail at half the size below which that size has all the detail.
const SOFT_SHARE: f64 = 0.22;
/// Shorter side of the smallest photo, pixels.
const MIN_SIDE: usize = 240;

/// Pixels per side of a photo's finest detail: a power of two.
pub(crate) fn detail_pixels(photo: &Texture) -> usize {
    if photo.width().min(photo.height()).div_ceil(2) < MIN_SIDE {
        return 1;
    }
    let half = photo.shrunk(2);
    let is_soft = mean_square_detail(photo) < SOFT_SHARE * mean_square_detail(&half);
    if is_soft { 2 * detail_pixels(&half) } else { 1 }
}

fn mean_square_detail(photo: &Texture) -> f64 {
    let photo = Planes::new(photo);
    let grey = |y: usize| -> Vec<f32> {
        let [r, g, b] = [0, 1, 2].map(|channel| photo.row(channel, y));
        (0..photo.width).map(|x| ((r[x] + g[x]) + b[x]) / 3.0).collect()
    };
    let mut rows = [grey(0), grey(1), grey(2)];
    let mut sum = 0.0;
    for y in 1..photo.height - 1 {
        let [above, here, below] = &rows;
        let detail = |x: usize| 4.0 * here[x] - ((here[x - 1] + here[x + 1]) + (above[x] + below[x]));
        sum += (1..photo.width - 1).map(|x| f64::from(detail(x)).powi(2)).sum::<f64>();
        rows.rotate_left(1);
        if y + 2 < photo.height {
            rows[2] = grey(y + 2);
        }
    }
    sum / ((photo.width - 2) * (photo.height - 2)) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use liveview::image::ImageRgb;

    #[test]
    fn detail_of_an_enlarged_photo_is_as_large_as_it_was_enlarged() {
        let value = |at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as f32 / 255.0;
        let sharp = ImageRgb::new(360, 270, (0..360 * 270 * 3).map(value).collect()).unwrap();
        let detail = |factor: usize| {
            let photo = sharp.clone().resized(factor * sharp.width(), factor * sharp.height()).unwrap();
            detail_pixels(&Texture::new(&photo))
        };
        assert_eq!([1, 2, 4].map(detail), [1, 2, 4]);
    }
}
