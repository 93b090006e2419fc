//! The depth of a photo as the page reads it: 16 bits a pixel, compressed without loss.
//!
//! A pixel's code: the lower 15 bits are 0 where there is no depth, else 1 + disparity / step; the highest bit is set
//! where other photos confirm it. What is not confirmed is noise below a pixel of parallax, and rounded to that.
//!
//! The bytes, compressed (zlib): step and the disparity of a pixel of parallax (f32, 1/scene unit, little endian); the
//! highest bits, eight pixels a byte, the first lowest; then of each pixel the difference of the lower bits from their
//! prediction, as 2d or −2d − 1, first all high bytes, then all low ones. The prediction is the median of left, above,
//! and left + above − above left (0 outside).

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use liveview_surface::{ConfirmedDisparity, PhotoDisparity};

/// Largest value of the lower bits.
const LARGEST: f32 = 32767.0;
const CONFIRMED: u16 = 1 << 15;

/// The depth of a photo: codes of pixels, row by row.
#[derive(Debug)]
pub(crate) struct DepthCode {
    codes: Vec<u16>,
    width: usize,
    step: f32,
    pixel: f32,
}

impl DepthCode {
    /// With so many steps to a pixel of parallax, or fewer where the depth range needs more than 15 bits.
    pub(crate) fn new((found, confirmed): (&PhotoDisparity, &ConfirmedDisparity), steps_per_pixel: u16) -> Self {
        let (found, pixel) = (&found.disparity, found.disparity_per_pixel);
        let known = || confirmed.disparity.iter().chain(found).copied().filter(|disparity| disparity.is_finite());
        let step = (pixel / f32::from(steps_per_pixel)).max(known().fold(0.0, f32::max) / (LARGEST - 1.0));
        let per_pixel = (pixel / step).round().max(1.0);
        let code = |(&found, &confirmed): (&f32, &f32)| match (confirmed >= 0.0, found >= 0.0) {
            (true, _) => CONFIRMED | (1.0 + (confirmed / step).round()) as u16,
            (false, true) => (1.0 + (found / step / per_pixel).round() * per_pixel).min(LARGEST) as u16,
            (false, false) => 0,
        };
        let codes = found.iter().zip(&confirmed.disparity).map(code).collect();
        Self { codes, width: found.ncols(), step, pixel }
    }

    /// With fewer steps to a pixel of parallax.
    pub(crate) fn coarser(&self, steps_per_pixel: u16) -> Self {
        let times = (self.pixel / self.step / f32::from(steps_per_pixel)).round().max(1.0);
        let code = |&code: &u16| match code & !CONFIRMED {
            0 => 0,
            value => code & CONFIRMED | (1.0 + (f32::from(value - 1) / times).round()) as u16,
        };
        Self { codes: self.codes.iter().map(code).collect(), step: self.step * times, ..*self }
    }

    /// The compressed bytes, by a level from 1 (fast) to 9 (small).
    pub(crate) fn compressed(&self, level: u32) -> Vec<u8> {
        let (count, width) = (self.codes.len(), self.width);
        let value = |at: usize| i32::from(self.codes[at] & !CONFIRMED);
        let mut bytes = [self.step, self.pixel].map(f32::to_le_bytes).concat();
        bytes.extend(self.codes.chunks(8).map(|codes| {
            codes.iter().enumerate().fold(0, |byte, (bit, code)| byte | u8::from(code & CONFIRMED != 0) << bit)
        }));
        let difference = |at: usize| {
            let (inside, below) = (at % width, at >= width);
            let left = if inside > 0 { value(at - 1) } else { 0 };
            let above = if below { value(at - width) } else { 0 };
            let corner = if inside > 0 && below { value(at - width - 1) } else { 0 };
            let (low, high) = (left.min(above), left.max(above));
            let difference = value(at) - (left + above - corner).clamp(low, high);
            (difference << 1 ^ difference >> 31) as u16
        };
        let differences: Vec<u16> = (0..count).map(difference).collect();
        bytes.extend(differences.iter().map(|value| (value >> 8) as u8));
        bytes.extend(differences.iter().map(|value| (value & 0xFF) as u8));
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(level));
        encoder.write_all(&bytes).and_then(|()| encoder.finish()).expect("writing to memory")
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;

    use super::*;

    /// The inverse of [`DepthCode::compressed`], as the page has it.
    fn decoded(bytes: &[u8], (width, height): (usize, usize)) -> (f32, f32, Vec<u16>) {
        let mut data = Vec::new();
        ZlibDecoder::new(bytes).read_to_end(&mut data).unwrap();
        let (count, flags) = (width * height, 8);
        let high = flags + count.div_ceil(8);
        assert_eq!(data.len(), high + 2 * count);
        let mut codes = vec![0_u16; count];
        for at in 0..count {
            let (x, y) = (at % width, at / width);
            let value = |at: usize| i32::from(codes[at]);
            let left = if x > 0 { value(at - 1) } else { 0 };
            let above = if y > 0 { value(at - width) } else { 0 };
            let corner = if x > 0 && y > 0 { value(at - width - 1) } else { 0 };
            let mut prediction = [left, above, left + above - corner];
            prediction.sort_unstable();
            let code = u16::from_be_bytes([data[high + at], data[high + count + at]]);
            codes[at] = (prediction[1] + (i32::from(code >> 1) ^ -i32::from(code & 1))) as u16;
        }
        let number = |at: usize| f32::from_le_bytes(data[at..at + 4].try_into().unwrap());
        let is_confirmed = |at: usize| data[flags + at / 8] >> (at % 8) & 1 == 1;
        let codes = codes.iter().enumerate().map(|(at, &code)| code | if is_confirmed(at) { CONFIRMED } else { 0 });
        (number(0), number(4), codes.collect())
    }

    #[test]
    fn compression_is_lossless() {
        let mut seed = 1_u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 16) as u16
        };
        for (width, height) in [(1, 1), (7, 5), (16, 3)] {
            let codes: Vec<u16> = (0..width * height).map(|_| random()).collect();
            let code = DepthCode { codes: codes.clone(), width, step: 0.25, pixel: 4.0 };
            assert_eq!(decoded(&code.compressed(9), (width, height)), (0.25, 4.0, codes));
        }
        let code = DepthCode { codes: vec![0, 1, CONFIRMED | 1, CONFIRMED | 18, 9], width: 5, step: 0.25, pixel: 4.0 };
        let coarser = code.coarser(4);
        assert_eq!((coarser.step, coarser.codes), (1.0, vec![0, 1, CONFIRMED | 1, CONFIRMED | 5, 3]));
    }
}
