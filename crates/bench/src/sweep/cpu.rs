//! The processor that a sweep ran on.

use std::fs;

/// The name, where the system reports it (Linux), and the widest vector instructions, which decide how fast networks run.
pub(super) fn cpu() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned());
    vectors().map_or_else(|| name.clone(), |vectors| format!("{name} ({vectors})"))
}

#[cfg(target_arch = "x86_64")]
fn vectors() -> Option<&'static str> {
    use std::arch::is_x86_feature_detected as has;
    if has!("avx512f") {
        return Some("AVX-512");
    }
    has!("avx2").then_some("AVX2")
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> Option<&'static str> {
    None
}
