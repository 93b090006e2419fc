//! Visualisation: colour maps, difference pictures, and pictures side by side.

use ndarray::ArrayView2;

use liveview::ImageRgb;

/// Evenly spaced colours from 0 (far, dark) to 1 (near, light). Their lightness increases
/// monotonically, so that the map is readable in greyscale.
const COLOURS: [[f32; 3]; 6] = [
    [0.05, 0.03, 0.16],
    [0.24, 0.08, 0.45],
    [0.56, 0.16, 0.50],
    [0.87, 0.32, 0.38],
    [0.99, 0.62, 0.33],
    [0.99, 0.95, 0.70],
];

/// Pixels between adjacent pictures.
const GAP: usize = 4;

/// A map `[height, width]` in colour: dark at `low`, light at `high`. Values outside are clamped;
/// non-finite values are black.
pub fn coloured(map: ArrayView2<'_, f32>, low: f32, high: f32) -> ImageRgb {
    let colour = |value: f32| {
        let step = ((value - low) / (high - low)).clamp(0.0, 1.0) * (COLOURS.len() - 1) as f32;
        if !step.is_finite() {
            return [0.0; 3];
        }
        let first = (step as usize).min(COLOURS.len() - 2);
        let mix = step - first as f32;
        std::array::from_fn(|c| (1.0 - mix) * COLOURS[first][c] + mix * COLOURS[first + 1][c])
    };
    let (height, width) = map.dim();
    from_pixels(width, height, |x, y| colour(map[(y, x)]))
}

/// `factor` · |a − b| per channel, at most 1. If the sizes differ, covers the part that both have.
pub fn difference(a: &ImageRgb, b: &ImageRgb, factor: f32) -> ImageRgb {
    from_pixels(a.width().min(b.width()), a.height().min(b.height()), |x, y| {
        let (a, b) = (a.pixel(x, y), b.pixel(x, y));
        std::array::from_fn(|c| (factor * (a[c] - b[c]).abs()).min(1.0))
    })
}

/// The pictures in a row, aligned at the top, on white.
pub fn side_by_side(pictures: &[&ImageRgb]) -> ImageRgb {
    let height = pictures.iter().map(|p| p.height()).max().unwrap_or(0);
    let width = pictures.iter().map(|p| p.width() + GAP).sum::<usize>().saturating_sub(GAP);
    let mut data = vec![1.0; 3 * width * height];
    let mut left = 0;
    for picture in pictures {
        for (y, row) in picture.data().chunks_exact(3 * picture.width().max(1)).enumerate() {
            let at = 3 * (y * width + left);
            data[at..at + row.len()].copy_from_slice(row);
        }
        left += picture.width() + GAP;
    }
    ImageRgb::new(width, height, data).expect("three values per pixel")
}

fn from_pixels(width: usize, height: usize, colour: impl Fn(usize, usize) -> [f32; 3]) -> ImageRgb {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let data = pixels.flat_map(|(x, y)| colour(x, y)).collect();
    ImageRgb::new(width, height, data).expect("three values per pixel")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coloured_is_lighter_for_larger_values_and_black_for_nan() {
        let map = ndarray::array![[0.0, 1.0, 2.0, 9.0, f32::NAN]];
        let picture = coloured(map.view(), 0.0, 2.0);
        let lightness: Vec<f32> = (0..5).map(|x| picture.pixel(x, 0).iter().sum()).collect();
        assert!(lightness[0] < lightness[1] && lightness[1] < lightness[2], "{lightness:?}");
        assert_eq!((lightness[2], lightness[4]), (lightness[3], 0.0));
        assert_eq!(coloured(map.view(), 1.0, 1.0).pixel(1, 0), [0.0; 3]);
    }

    #[test]
    fn side_by_side_aligns_pictures_at_the_top_on_white() {
        let (red, blue) = (from_pixels(2, 1, |_, _| [1.0, 0.0, 0.0]), from_pixels(1, 2, |_, _| [0.0, 0.0, 1.0]));
        let both = side_by_side(&[&red, &blue]);
        assert_eq!((both.width(), both.height()), (2 + GAP + 1, 2));
        assert_eq!((both.pixel(1, 0), both.pixel(2 + GAP, 1)), ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]));
        assert_eq!((both.pixel(1, 1), both.pixel(3, 0)), ([1.0; 3], [1.0; 3]));
        assert_eq!(difference(&red, &blue, 4.0).pixel(0, 0), [1.0, 0.0, 1.0]);
    }
}
