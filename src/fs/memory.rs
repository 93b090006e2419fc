//! Memory asked for before it is taken: a failed allocation would end the process, here it is refused by name.

use std::hint::black_box;

/// Memory that cannot be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("takes about {} MB of memory; {}", needed / 1_000_000, had(*available))]
pub struct MemoryError {
    /// Bytes asked for.
    pub needed: u64,
    /// Bytes that can be had, where the system tells; `None` for a limit of the process's address space.
    pub available: Option<u64>,
}

fn had(available: Option<u64>) -> String {
    available.map_or_else(
        || "this process may not have as much (ulimit -v)".to_owned(),
        |bytes| format!("{} MB can be had", bytes / 1_000_000),
    )
}

/// Refuses more bytes than can be had, by the machine's memory, the container's and the limit of the process.
///
/// # Errors
///
/// [`MemoryError`].
pub fn check(needed: u64) -> Result<(), MemoryError> {
    let refused = |available| Err(MemoryError { needed, available });
    if let Some(available) = available().filter(|&available| available < needed) {
        return refused(Some(available));
    }
    // Address space alone: no page of it is touched.
    let mut room = Vec::<u8>::new();
    let reserved = usize::try_from(needed).is_ok_and(|bytes| room.try_reserve_exact(bytes).is_ok());
    black_box(&room);
    if reserved { Ok(()) } else { refused(None) }
}

/// What Linux says that a process can have without another one losing it, of that what the container may have at all.
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
    fn what_no_machine_has_is_refused() {
        assert_eq!(check(1 << 20), Ok(()));
        for needed in [1 << 60, u64::MAX] {
            let message = check(needed).unwrap_err().to_string();
            assert!(message.starts_with(&format!("takes about {} MB of memory; ", needed / 1_000_000)), "{message}");
        }
    }
}
