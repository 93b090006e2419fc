//! Photos as textures.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use crate::image::ImageRgb;

/// A view's photo as the warp samples it: RGB and a fourth channel of ones (whose sample is the
/// coverage), inside a border of zeros so that sampling needs no bounds test.
#[derive(Debug, Clone, Default)]
pub struct Texture {
    texels: Vec<[f32; 4]>,
    width: usize,
    height: usize,
    id: u64,
}

/// Zeros before the first and after the last pixel of a row or column: a coordinate clamped to one
/// pixel outside the image still has both its neighbours.
const BORDER: (usize, usize) = (1, 2);

/// 2⁻⁶⁴: smaller values become 0. With denormal values (below 2⁻¹²⁶) the network takes ten times as
/// long on some CPUs; the margin is for their products with weights.
const SMALLEST_VALUE: f32 = 1.0 / (1_u128 << 64) as f32;

impl Texture {
    /// Copies the photo; values below 2⁻⁶⁴ (absolute) become 0.
    pub fn new(photo: &ImageRgb) -> Self {
        let (width, height) = (photo.width(), photo.height());
        let (pixels, _) = photo.data().as_chunks::<3>();
        let stride = width + BORDER.0 + BORDER.1;
        // Row by row: zeroing all of it first would take as long again.
        let mut texels = Vec::with_capacity(stride * (height + BORDER.0 + BORDER.1));
        texels.resize(BORDER.0 * stride, [0.0; 4]);
        for row in pixels.chunks_exact(width) {
            texels.extend_from_slice(&[[0.0; 4]; BORDER.0]);
            texels.extend(row.iter().map(|rgb| {
                let [r, g, b] = rgb.map(|value| if value.abs() < SMALLEST_VALUE { 0.0 } else { value });
                [r, g, b, 1.0]
            }));
            texels.extend_from_slice(&[[0.0; 4]; BORDER.1]);
        }
        texels.resize(texels.len() + BORDER.1 * stride, [0.0; 4]);
        Self { texels, width, height, id: new_id() }
    }

    /// Identifies the photo: textures of one id have the same content.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// Columns of the photo.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the photo.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.texels.as_slice())
    }

    /// Colour of the pixel in column `x`, row `y`.
    ///
    /// # Panics
    ///
    /// If the row lies below the photo's border; other positions outside the photo are not checked.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 3] {
        let at = (y + BORDER.0) * (self.width + BORDER.0 + BORDER.1) + BORDER.0 + x;
        let [r, g, b, _] = self.texels[at];
        [r, g, b]
    }

    /// The photo shrunk by a factor of `cell`: averages of `cell`×`cell` pixels, of fewer at the
    /// right and lower edge.
    pub fn shrunk(&self, cell: usize) -> Self {
        let (width, height) = (self.width.div_ceil(cell), self.height.div_ceil(cell));
        let (stride, shrunk_stride) = (self.stride() as usize, width + BORDER.0 + BORDER.1);
        let mut texels = vec![[0.0; 4]; shrunk_stride * (height + BORDER.0 + BORDER.1)];
        let rows = texels.par_chunks_exact_mut(shrunk_stride).skip(BORDER.0).take(height);
        rows.enumerate().for_each(|(y, row)| {
            let texels = &mut row[BORDER.0..BORDER.0 + width];
            for y in y * cell..(y * cell + cell).min(self.height) {
                let pixels = &self.texels[(y + BORDER.0) * stride + BORDER.0..][..self.width];
                for (sum, pixels) in texels.iter_mut().zip(pixels.chunks(cell)) {
                    pixels.iter().for_each(|pixel| (0..4).for_each(|c| sum[c] += pixel[c]));
                }
            }
            texels.iter_mut().for_each(|sum| *sum = sum.map(|s| s / sum[3]));
        });
        Self { texels, width, height, id: new_id() }
    }

    /// Writes the photo to `out` with `amount` of its detail added: 4 times each pixel less its
    /// four neighbours. Neighbours outside are the pixel itself; the result is clamped to [0, 1].
    pub fn sharpen(&self, amount: f32, out: &mut Self) {
        let (width, height, stride) = (self.width, self.height, self.stride() as usize);
        (out.width, out.height, out.id) = (width, height, new_id());
        out.texels.resize(self.texels.len(), [0.0; 4]);
        let row = |y: usize| &self.texels[(y + BORDER.0) * stride + BORDER.0..][..width];
        let rows = out.texels.par_chunks_exact_mut(stride).enumerate();
        rows.for_each(|(y, out)| {
            let Some(y) = y.checked_sub(BORDER.0).filter(|&y| y < height) else { return out.fill([0.0; 4]) };
            let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|y| row(y).as_flattened());
            out[..BORDER.0].fill([0.0; 4]);
            out[BORDER.0 + width..].fill([0.0; 4]);
            sharpen_row(rows, amount, out[BORDER.0..BORDER.0 + width].as_flattened_mut());
        });
    }

    /// Texels from one row to the next.
    pub fn stride(&self) -> u32 {
        (self.width + BORDER.0 + BORDER.1) as u32
    }

    /// All texels but the last row, and all but the first: a texel and the one below it have the
    /// same index, and one bounds check is enough for both.
    #[inline(always)]
    pub fn upper_and_lower(&self) -> (&[[f32; 4]], &[[f32; 4]]) {
        let stride = self.stride() as usize;
        let lower = &self.texels[stride..];
        (&self.texels[..lower.len()], lower)
    }
}

/// Never 0, the id of an empty texture.
fn new_id() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    LAST.fetch_add(1, Ordering::Relaxed) + 1
}

/// Writes a row with `amount` of its detail added, given the rows above and below it; the four
/// channels are interleaved.
#[pulp::with_simd(sharpen_row = crate::simd::arch())]
#[inline(always)]
fn sharpen_row_with<'a, S: pulp::Simd>(
    _simd: S,
    [above, here, below]: [&'a [f32]; 3],
    amount: f32,
    out: &'a mut [f32],
) {
    // The fourth channel is 1 everywhere, and stays 1.
    let sharpened = |here: f32, [above, below, left, right]: [f32; 4]| {
        (here + amount * (4.0 * here - above - below - left - right)).clamp(0.0, 1.0)
    };
    let end = here.len();
    let inner = |values: &'a [f32]| &values[4..end.max(8) - 4];
    if end > 8 {
        let around = inner(above).iter().zip(inner(below)).zip(&here[..end - 8]).zip(&here[8..]);
        let pixels = inner(here).iter().zip(around).zip(&mut out[4..end - 4]);
        for ((&here, (((&above, &below), &left), &right)), out) in pixels {
            *out = sharpened(here, [above, below, left, right]);
        }
    }
    for i in (0..4).chain(end - 4..end) {
        let (left, right) = (if i < 4 { i } else { i - 4 }, if i + 4 < end { i + 4 } else { i });
        out[i] = sharpened(here[i], [above[i], below[i], here[left], here[right]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_denormal_values_become_zero() {
        let values = [f32::from_bits(1), -f32::MIN_POSITIVE, SMALLEST_VALUE / 2.0, SMALLEST_VALUE, 0.5, 1.0];
        let photo = Texture::new(&ImageRgb::new(2, 1, values.to_vec()).unwrap());
        assert_eq!([photo.pixel(0, 0), photo.pixel(1, 0)].concat(), [0.0, 0.0, 0.0, SMALLEST_VALUE, 0.5, 1.0]);
    }

    fn photo(width: usize, height: usize) -> ImageRgb {
        let values = (0..3 * width * height).map(|i| (i * 37 % 101) as f32 / 100.0).collect();
        ImageRgb::new(width, height, values).unwrap()
    }

    /// That the texels inside are these colours and 1, and those of the border 0.
    fn assert_texels(texture: &Texture, (width, height): (usize, usize), colour: impl Fn(usize, usize, usize) -> f32) {
        assert_eq!((texture.width(), texture.height(), texture.stride() as usize), (width, height, width + 3));
        assert_eq!(
            (texture.texels.len(), texture.bytes()),
            ((width + 3) * (height + 3), 16 * (width + 3) * (height + 3))
        );
        for (at, texel) in texture.texels.iter().enumerate() {
            let (x, y) = ((at % (width + 3)).wrapping_sub(1), (at / (width + 3)).wrapping_sub(1));
            if x < width && y < height {
                let close = (0..3).all(|c| (texel[c] - colour(x, y, c)).abs() < 1e-6);
                assert!(close && texel[3] == 1.0, "({x}, {y}) of {width}x{height}: {texel:?}");
                assert_eq!(texture.pixel(x, y), texel[..3]);
            } else {
                assert_eq!(*texel, [0.0; 4], "texel {at} of {width}x{height}");
            }
        }
    }

    #[test]
    fn shrunk_photos_hold_the_means_of_their_cells() {
        for (width, height, cell) in [(8, 6, 2), (7, 5, 2), (10, 11, 4), (3, 2, 5)] {
            let photo = photo(width, height);
            let mean = |x: usize, y: usize, c: usize| {
                let (rows, columns) = (cell * y..(cell * y + cell).min(height), cell * x..(cell * x + cell).min(width));
                let count = rows.len() * columns.len();
                rows.flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| photo.pixel(x, y)[c]).sum::<f32>()
                    / count as f32
            };
            let shrunk = Texture::new(&photo).shrunk(cell);
            assert_texels(&shrunk, (width.div_ceil(cell), height.div_ceil(cell)), mean);
        }
    }

    #[test]
    fn sharpened_photos_have_their_detail_added() {
        let mut out = Texture::new(&photo(40, 3));
        for (width, height) in [(1, 1), (2, 3), (3, 1), (9, 6), (20, 4)] {
            let photo = photo(width, height);
            let texture = Texture::new(&photo);
            assert_texels(&texture, (width, height), |x, y, c| photo.pixel(x, y)[c]);
            texture.sharpen(0.1, &mut out);
            let sharpened = |x: usize, y: usize, c: usize| {
                let here = photo.pixel(x, y)[c];
                let around = [
                    (x.saturating_sub(1), y),
                    ((x + 1).min(width - 1), y),
                    (x, y.saturating_sub(1)),
                    (x, (y + 1).min(height - 1)),
                ];
                let around: f32 = around.into_iter().map(|(x, y)| photo.pixel(x, y)[c]).sum();
                (here + 0.1 * (4.0 * here - around)).clamp(0.0, 1.0)
            };
            assert_texels(&out, (width, height), sharpened);
            assert!(out.id() != texture.id() && out.id() > 0);
        }
    }
}
