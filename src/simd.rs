//! The vector instructions that loops are compiled for; all of them give the same bits.

/// At most 256 bits: with AVX-512, semi-global aggregation took 40 % longer and splats a fifth.
pub(crate) fn arch() -> pulp::Arch {
    match pulp::Arch::new() {
        #[cfg(target_arch = "x86_64")]
        pulp::Arch::V4(simd) => pulp::Arch::V3(*simd),
        arch => arch,
    }
}

/// The widest available: AVX-512 made blend and composite a tenth faster, the warp a twentieth.
pub(crate) fn wide_arch() -> pulp::Arch {
    pulp::Arch::new()
}
