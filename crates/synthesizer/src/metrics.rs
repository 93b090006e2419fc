//! PSNR and SSIM of a picture against the ground truth, over all channels, values in [0, 1].

use liveview::{Frame, ImageRgb};
use ndarray::Array2;

/// PSNR and SSIM of a picture against the ground truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Peak signal-to-noise ratio in dB.
    pub psnr: f64,
    /// Structural similarity, at most 1.
    pub ssim: f64,
}

impl Score {
    /// Width in pixels of the border that [`Score::of`] excludes.
    pub const BORDER: usize = 16;

    /// The score of a picture without its border; `None` if the picture is too small or the sizes
    /// differ.
    pub fn of(picture: &ImageRgb, truth: &ImageRgb) -> Option<Self> {
        let score = Self { psnr: psnr(picture, truth, Self::BORDER), ssim: ssim(picture, truth, Self::BORDER) };
        (!score.psnr.is_nan() && !score.ssim.is_nan()).then_some(score)
    }

    /// The score of the picture that is delivered: inpainted ([`Frame::picture`]), in 8 bits as in a PNG file; and the
    /// PSNR in dB of the pixels that some view covers, without the border, `None` if all are covered, or none of the
    /// inner ones.
    pub fn of_delivered(frame: &Frame, truth: &ImageRgb) -> (Option<Self>, Option<f64>) {
        let picture = frame.picture().in_8_bits();
        (Self::of(&picture, truth), psnr_covered(&picture, &frame.transmittance, truth))
    }
}

/// PSNR of the pixels of a picture with a transmittance (`[h, w]`) below 1/2 ([`Score::of_delivered`]).
fn psnr_covered(picture: &ImageRgb, transmittance: &Array2<f32>, truth: &ImageRgb) -> Option<f64> {
    let is_covered = |share: &f32| *share < 0.5;
    if picture.size() != truth.size() || transmittance.iter().all(is_covered) {
        return None;
    }
    let (height, width) = transmittance.dim();
    let is_inner = |at: usize, side: usize| (Score::BORDER..side.saturating_sub(Score::BORDER)).contains(&at);
    let (mut sum, mut count) = (0.0, 0.0);
    let colours = picture.data().chunks(3).zip(truth.data().chunks(3));
    for (((y, x), share), (a, b)) in transmittance.indexed_iter().zip(colours) {
        if is_covered(share) && is_inner(y, height) && is_inner(x, width) {
            sum += a.iter().zip(b).map(|(&x, &y)| f64::from(x - y).powi(2)).sum::<f64>();
            count += 3.0;
        }
    }
    (count > 0.0).then(|| -10.0 * (sum / count).log10())
}

/// Peak signal-to-noise ratio in dB, excluding a `border` (pixels) on each side. Infinite for equal
/// pictures; NaN if the sizes differ or no pixel is left.
pub fn psnr(picture: &ImageRgb, truth: &ImageRgb, border: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for_inner_rows(picture, truth, border, |a, b| {
        sum += a.iter().zip(b).map(|(&x, &y)| f64::from(x - y).powi(2)).sum::<f64>();
        count += a.len() as f64;
    });
    -10.0 * (sum / count).log10()
}

/// Structural similarity (Wang et al. 2004), the mean over pixels and channels, with an 11×11
/// Gaussian window of σ = 1.5 at all positions where it fits: the value of skimage's
/// `structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False)`. Excludes
/// a `border` (pixels) on each side; NaN if the sizes differ or the window does not fit.
pub fn ssim(picture: &ImageRgb, truth: &ImageRgb, border: usize) -> f64 {
    let (mut a, mut b, mut width) = (Vec::new(), Vec::new(), 0);
    for_inner_rows(picture, truth, border, |x, y| {
        width = x.len() / 3;
        a.extend(x.iter().map(|&v| f64::from(v)));
        b.extend(y.iter().map(|&v| f64::from(v)));
    });
    if width < WINDOW || a.len() < WINDOW * 3 * width {
        return f64::NAN;
    }
    let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(x, y)| x * y).collect::<Vec<_>>();
    let [mean_a, mean_b, aa, bb, ab] =
        [a.clone(), b.clone(), product(&a, &a), product(&b, &b), product(&a, &b)].map(|map| blur(&map, width));
    let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
    let score = |i: usize| {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb, cov) = (aa[i] - ma * ma, bb[i] - mb * mb, ab[i] - ma * mb);
        (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    };
    (0..mean_a.len()).map(score).sum::<f64>() / mean_a.len() as f64
}

/// Side of the SSIM window in pixels.
const WINDOW: usize = 11;

/// Gaussian blur of an interleaved RGB map, at all positions where the window fits.
fn blur(map: &[f64], width: usize) -> Vec<f64> {
    let half = (WINDOW / 2) as f64;
    let weights: [f64; WINDOW] = std::array::from_fn(|i| (-(i as f64 - half).powi(2) / (2.0 * 1.5 * 1.5)).exp());
    let total: f64 = weights.iter().sum();
    let blurred =
        |values: &[f64], at: usize, step: usize| (0..WINDOW).map(|i| weights[i] / total * values[at + i * step]).sum();
    let (row, kept) = (3 * width, 3 * (width - WINDOW + 1));
    let rows = map.len() / row;
    let across: Vec<f64> = (0..rows * kept).map(|i| blurred(map, i / kept * row + i % kept, 3)).collect();
    (0..(rows - WINDOW + 1) * kept).map(|i| blurred(&across, i, kept)).collect()
}

/// Calls `f` with each row of both pictures, without the border; never if the sizes differ.
fn for_inner_rows(a: &ImageRgb, b: &ImageRgb, border: usize, mut f: impl FnMut(&[f32], &[f32])) {
    let (width, height) = (a.width(), a.height());
    if (width, height) != (b.width(), b.height()) || width <= 2 * border {
        return;
    }
    for y in border..height.saturating_sub(border) {
        let row = 3 * (y * width + border)..3 * ((y + 1) * width - border);
        f(&a.data()[row.clone()], &b.data()[row]);
    }
}
