//! Checks of available memory before it is allocated: a failed allocation would abort the process,
//! a failed check is an error.

use std::hint::black_box;

/// More memory is needed than is available.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("takes about {} MB of memory; {}", needed / 1_000_000, limit(*available))]
pub struct MemoryError {
    /// Bytes needed.
    pub needed: u64,
    /// Bytes available by the system's report; `None` for a limit of the process's address space.
    pub available: Option<u64>,
}

fn limit(available: Option<u64>) -> String {
    available.map_or_else(
        || "the address space of this process is limited to less (ulimit -v)".to_owned(),
        |bytes| format!("{} MB are available", bytes / 1_000_000),
    )
}

/// Bytes of address space that a thread reserves for its stack and its heap (glibc), most of them never used.
const THREAD_BYTES: u64 = 72 << 20;

/// Refuses more bytes than are available, by the memory of the machine and the container and the
/// limit of the process, in which so many threads begin to work.
///
/// # Errors
///
/// [`MemoryError`].
pub fn check(needed: u64, threads: usize) -> Result<(), MemoryError> {
    let refused = |available| Err(MemoryError { needed, available });
    if let Some(available) = available().filter(|&available| available < needed) {
        return refused(Some(available));
    }
    let reserved = needed.saturating_add(threads as u64 * THREAD_BYTES);
    if usize::try_from(reserved).is_ok_and(can_reserve) { Ok(()) } else { refused(None) }
}

/// Whether the process can reserve so many bytes of address space; no page of it is touched.
pub fn can_reserve(bytes: usize) -> bool {
    let mut reserved = Vec::<u8>::new();
    let is_reserved = reserved.try_reserve_exact(bytes).is_ok();
    black_box(&reserved); // not optimised away
    is_reserved
}

/// Bytes that Linux reports as available without swapping out other processes, at most the limit of
/// the container.
fn available() -> Option<u64> {
    let read = |path| std::fs::read_to_string(path).ok();
    let machine = read("/proc/meminfo").and_then(|text| {
        let kilobytes = |name: &str| -> Option<u64> {
            let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
            line.split_whitespace().next()?.parse().ok()
        };
        Some(1024 * (kilobytes("MemAvailable")? + kilobytes("SwapFree").unwrap_or(0)))
    });
    let container = read("/sys/fs/cgroup/memory.max").and_then(|text| text.trim().parse().ok());
    machine.into_iter().chain(container).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_more_than_any_machine_has_is_an_error() {
        assert_eq!(check(1 << 20, 0), Ok(()));
        for needed in [1 << 60, u64::MAX] {
            let message = check(needed, 2).unwrap_err().to_string();
            assert!(message.starts_with(&format!("takes about {} MB of memory; ", needed / 1_000_000)), "{message}");
        }
    }
}
