//! Which vector instructions loops are compiled for; all of them give the same bits.

/// Of 256 bits at most: with AVX-512 semi-global aggregation took 40 % longer, splats a fifth.
pub(crate) fn arch() -> pulp::Arch {
    match pulp::Arch::new() {
        #[cfg(target_arch = "x86_64")]
        pulp::Arch::V4(simd) => pulp::Arch::V3(*simd),
        arch => arch,
    }
}

/// The widest there are: AVX-512 took a tenth off blend and composite, a twentieth off the warp.
pub(crate) fn wide_arch() -> pulp::Arch {
    pulp::Arch::new()
}
