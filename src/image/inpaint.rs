//! Inpaints the pixels that no view covers, so that a picture has no black borders. Their colours
//! are a guess: [`crate::render::Frame::raw`] keeps these pixels black.

use ndarray::Array2;

use super::ImageRgb;

/// One level of the image pyramid: each pixel is its colour times its weight, and the weight in [0,
/// 1].
struct Level {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 4]>,
}

impl Level {
    fn at(&self, x: usize, y: usize) -> [f32; 4] {
        self.pixels[y.min(self.height - 1) * self.width + x.min(self.width - 1)]
    }

    /// The level at half the size. Weights saturate at 1, so that distant pixels fill only what
    /// near ones leave uncovered.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let pixel = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| self.at(x, y));
            let sum: [f32; 4] = std::array::from_fn(|c| four.iter().map(|p| p[c]).sum());
            sum.map(|s| s / sum[3].max(1.0))
        };
        Self { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    /// Bilinear sample of this level at pixel (`x`, `y`) of the level twice its size.
    fn enlarged(&self, x: usize, y: usize) -> [f32; 4] {
        let split = |at: usize, side: usize| {
            let position = ((at as f32 + 0.5) / 2.0 - 0.5).clamp(0.0, (side - 1) as f32);
            (position as usize, position.fract())
        };
        let ((left, across), (top, down)) = (split(x, self.width), split(y, self.height));
        let mix = |a: [f32; 4], b: [f32; 4], t: f32| std::array::from_fn(|c| a[c] + t * (b[c] - a[c]));
        let row = |y| mix(self.at(left, y), self.at(left + 1, y), across);
        mix(row(top), row(top + 1), down)
    }
}

/// Fills the uncovered part of each pixel (`transmittance` `[height, width]`, as in
/// [`crate::render::Frame`]) with the surrounding colours (push-pull pyramid, Gortler et al. 1996).
/// Covered pixels are bitwise unchanged.
///
/// # Panics
///
/// If the sizes differ.
pub fn inpaint_uncovered(picture: &ImageRgb, transmittance: &Array2<f32>) -> ImageRgb {
    let (width, height) = (picture.width(), picture.height());
    assert_eq!(transmittance.dim(), (height, width), "one transmittance per pixel");
    if transmittance.iter().all(|&t| t == 0.0) {
        return picture.clone();
    }
    let base = picture.data().chunks_exact(3).zip(transmittance).map(|(rgb, t)| [rgb[0], rgb[1], rgb[2], 1.0 - t]);
    let base = Level { width, height, pixels: base.collect() };
    let halved = |level: &Level| (level.width * level.height > 1).then(|| level.halved());
    let levels: Vec<Level> = std::iter::successors(Some(base), halved).collect();
    let filled = levels.into_iter().rev().reduce(|coarse, mut level| {
        for (i, pixel) in level.pixels.iter_mut().enumerate().filter(|(_, pixel)| pixel[3] < 1.0) {
            let behind = coarse.enlarged(i % level.width, i / level.width);
            let missing = 1.0 - pixel[3];
            (0..4).for_each(|c| pixel[c] += missing * behind[c]);
        }
        level
    });
    let rgb: Vec<[f32; 3]> = filled.expect("at least one level").pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    ImageRgb::new(width, height, rgb.into_flattened()).expect("three values per pixel")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uncovered_pixels_take_the_surrounding_colour() {
        let mut transmittance = Array2::zeros((9, 13));
        let mut rgb = vec![0.25; 3 * 9 * 13];
        for y in 0..9 {
            for x in 0..4 {
                transmittance[(y, x)] = 1.0;
                rgb[3 * (13 * y + x)..3 * (13 * y + x) + 3].fill(0.0);
            }
        }
        let filled = inpaint_uncovered(&ImageRgb::new(13, 9, rgb).unwrap(), &transmittance);
        assert!(filled.data().iter().all(|c| (c - 0.25).abs() < 1e-6), "{:?}", filled.data());
    }

    #[test]
    fn covered_pixels_are_unchanged_and_an_uncovered_picture_stays_black() {
        let picture = ImageRgb::new(5, 3, (0..45).map(|i| i as f32 / 45.0).collect()).unwrap();
        assert_eq!(inpaint_uncovered(&picture, &Array2::zeros((3, 5))).data(), picture.data());
        let black = ImageRgb::new(5, 3, vec![0.0; 45]).unwrap();
        assert_eq!(inpaint_uncovered(&black, &Array2::ones((3, 5))).data(), black.data());
    }

    #[test]
    fn a_gap_is_a_ramp_from_one_side_to_the_other() {
        let grey = |values: &[f32]| values.iter().flat_map(|&value| [value; 3]).collect::<Vec<_>>();
        let picture = ImageRgb::new(4, 1, grey(&[0.0, 0.0, 0.0, 0.8])).unwrap();
        let filled = inpaint_uncovered(&picture, &ndarray::arr2(&[[0.0, 1.0, 1.0, 0.0]]));
        // At half the size the two sides are whole pixels, of which the gap is sampled at 1/4 and 3/4.
        let expected = grey(&[0.0, 0.2, 0.6, 0.8]);
        assert!(filled.data().iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", filled.data());
        // Half transparent: half of its own colour, and half of what lies around.
        let picture = ImageRgb::new(2, 2, grey(&[0.4, 0.4, 0.4, 0.1])).unwrap();
        let filled = inpaint_uncovered(&picture, &ndarray::arr2(&[[0.0, 0.0], [0.0, 0.5]]));
        assert!((filled.pixel(1, 1)[0] - (0.1 + 0.5 * 1.3 / 3.5)).abs() < 1e-6, "{:?}", filled.data());
    }
}
