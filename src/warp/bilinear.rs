//! Bilinear interpolation at the [`SamplePositions`] of a run of pixels, one output array per
//! channel.
//!
//! A texel and its right neighbour lie side by side in memory: the vertical step interpolates both,
//! eight numbers at once. For the horizontal step they are transposed to one register per channel,
//! with instructions that plain loops do not compile to (those transpose through memory). Measured
//! alternatives: docs/design-log/speed.md.

use pulp::Simd;

use super::run::RUN;
use super::sample_positions::SamplePositions;
use super::texture::Texture;

/// Red, green, blue and coverage.
pub(crate) type Channels<'a> = [&'a mut [f32; RUN]; 4];

/// Interpolates each sample between the texel of its position, its right neighbour and the two
/// below, and multiplies its colours by `gains`.
#[inline(always)]
#[cfg_attr(not(target_arch = "x86_64"), expect(unused_variables))]
pub fn sample<S: Simd>(simd: S, texture: &Texture, positions: &SamplePositions, gains: [f32; 3], out: Channels<'_>) {
    #[cfg(target_arch = "x86_64")]
    {
        let simd = &simd as &dyn std::any::Any;
        let avx = simd.downcast_ref::<pulp::x86::V4>().map(|simd| &**simd);
        if let Some(&simd) = avx.or_else(|| simd.downcast_ref()) {
            return transposed::sample(simd, texture, positions, gains, out);
        }
    }
    plain(texture, positions, gains, out);
}

/// Plain loops, for any processor.
#[inline(always)]
fn plain(texture: &Texture, positions: &SamplePositions, [red, green, blue]: [f32; 3], out: Channels<'_>) {
    let (upper, lower) = texture.upper_and_lower();
    let mut samples = [[0.0; 4]; RUN];
    for (k, sample) in samples.iter_mut().enumerate() {
        let (at, across, down) = (positions.texel[k] as usize, positions.across[k], positions.down[k]);
        let (upper, lower) = (upper[at..at + 2].as_flattened(), lower[at..at + 2].as_flattened());
        let mut pair = [0.0; 8];
        for i in 0..8 {
            pair[i] = upper[i] + (lower[i] - upper[i]) * down;
        }
        for i in 0..4 {
            sample[i] = pair[i] + (pair[i + 4] - pair[i]) * across;
        }
    }
    for ((channel, values), gain) in out.into_iter().enumerate().zip([red, green, blue, 1.0]) {
        values.iter_mut().zip(&samples).for_each(|(value, sample)| *value = sample[channel] * gain);
    }
}

/// The same bits, eight samples at a time with AVX.
#[cfg(target_arch = "x86_64")]
mod transposed {
    use std::arch::x86_64::__m256;

    use pulp::cast;
    use pulp::x86::V3;

    use super::{Channels, RUN, SamplePositions, Texture};

    #[inline(always)]
    pub(super) fn sample(simd: V3, texture: &Texture, positions: &SamplePositions, gains: [f32; 3], out: Channels<'_>) {
        let gains = gains.map(|gain| cast(simd.splat_f32x8(gain)));
        let times = |value, gain| simd.avx._mm256_mul_ps(value, gain);
        let rows = texture.upper_and_lower();
        let [red, green, blue, coverage] = out.map(|values| values.as_chunks_mut::<8>().0);
        for i in 0..RUN / 8 {
            let pair = |k: usize| pair(simd, rows, positions.texel[8 * i + k], positions.down[8 * i + k]);
            // One register holds the left texels of the samples k and k + 4, another their right
            // ones.
            let [p0, p1, p2, p3, p4, p5, p6, p7] =
                [pair(0), pair(1), pair(2), pair(3), pair(4), pair(5), pair(6), pair(7)];
            let left = |a, b| simd.avx._mm256_permute2f128_ps::<0x20>(a, b);
            let right = |a, b| simd.avx._mm256_permute2f128_ps::<0x31>(a, b);
            let left = by_channel(simd, [left(p0, p4), left(p1, p5), left(p2, p6), left(p3, p7)]);
            let right = by_channel(simd, [right(p0, p4), right(p1, p5), right(p2, p6), right(p3, p7)]);
            let across = cast(positions.across.as_chunks::<8>().0[i]);
            red[i] = cast(times(lerp(simd, left[0], right[0], across), gains[0]));
            green[i] = cast(times(lerp(simd, left[1], right[1], across), gains[1]));
            blue[i] = cast(times(lerp(simd, left[2], right[2], across), gains[2]));
            coverage[i] = cast(lerp(simd, left[3], right[3], across));
        }
    }

    /// The texel at `at` and its right neighbour, interpolated with the two below.
    #[inline(always)]
    fn pair(simd: V3, (upper, lower): (&[[f32; 4]], &[[f32; 4]]), at: u32, down: f32) -> __m256 {
        let (at, end) = (at as usize, at as usize + 2);
        let (upper, lower) = (&upper[at..end], &lower[at..end]);
        lerp(simd, cast([upper[0], upper[1]]), cast([lower[0], lower[1]]), cast(simd.splat_f32x8(down)))
    }

    #[inline(always)]
    fn lerp(simd: V3, from: __m256, to: __m256, share: __m256) -> __m256 {
        let avx = simd.avx;
        avx._mm256_add_ps(from, avx._mm256_mul_ps(avx._mm256_sub_ps(to, from), share))
    }

    /// Transposes both halves, four by four: one register per channel.
    #[inline(always)]
    fn by_channel(simd: V3, [a, b, c, d]: [__m256; 4]) -> [__m256; 4] {
        let avx = simd.avx;
        let (ab, cd) = (avx._mm256_unpacklo_ps(a, b), avx._mm256_unpacklo_ps(c, d));
        let (ab_high, cd_high) = (avx._mm256_unpackhi_ps(a, b), avx._mm256_unpackhi_ps(c, d));
        [
            avx._mm256_shuffle_ps::<0x44>(ab, cd),
            avx._mm256_shuffle_ps::<0xee>(ab, cd),
            avx._mm256_shuffle_ps::<0x44>(ab_high, cd_high),
            avx._mm256_shuffle_ps::<0xee>(ab_high, cd_high),
        ]
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::image::ImageRgb;

    #[test]
    fn transposed_samples_have_the_bits_of_plain_ones() {
        let Some(simd) = pulp::x86::V3::try_new() else {
            eprintln!("skipped: no AVX2 here");
            return;
        };
        let values = (0..3 * 40 * 30).map(|i| (i * 31 % 113) as f32 / 112.0).collect();
        let texture = Texture::new(&ImageRgb::new(40, 30, values).unwrap());
        let mut positions = SamplePositions::NEW;
        for i in 0..RUN {
            positions.texel[i] = (i as u32 * 211) % (texture.stride() * 31);
            (positions.across[i], positions.down[i]) = ((i as f32).sin().abs(), (i as f32 * 0.7).cos().abs());
        }
        let [mut found, mut expected] = [[[9.0; RUN]; 4]; 2];
        plain(&texture, &positions, GAINS, expected.each_mut());
        simd.vectorize(Sample(simd, &texture, &positions, found.each_mut()));
        let bits = |samples: [[f32; RUN]; 4]| samples.map(|channel| channel.map(f32::to_bits));
        assert_eq!(bits(found), bits(expected));
        assert!(expected.iter().all(|channel| channel.iter().any(|&value| value > 0.0)));
    }

    const GAINS: [f32; 3] = [0.9, 1.2, 1.0];

    struct Sample<'a>(pulp::x86::V3, &'a Texture, &'a SamplePositions, Channels<'a>);

    impl pulp::NullaryFnOnce for Sample<'_> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            transposed::sample(self.0, self.1, self.2, GAINS, self.3);
        }
    }
}
