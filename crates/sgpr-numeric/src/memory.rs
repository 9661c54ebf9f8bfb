//! How much memory there is to take.

/// Bytes that a computation may take: four fifths of what is free.
pub fn usable() -> u64 {
    free() / 5 * 4
}

/// Bytes that can be taken without swapping and within the limits of the process and of its
/// container; 8 GB where the system does not say.
fn free() -> u64 {
    let number = |path: &str| std::fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let line = |path: &str, name: &str, column: usize| -> Option<u64> {
        let text = std::fs::read_to_string(path).ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().nth(column)?.parse().ok()
    };
    let machine = line("/proc/meminfo", "MemAvailable:", 0).map(|kilobytes| kilobytes * 1024);
    let container = || {
        Some(
            number("/sys/fs/cgroup/memory.max")?
                .saturating_sub(number("/sys/fs/cgroup/memory.current")?),
        )
    };
    let process = || {
        let taken = line("/proc/self/status", "VmSize:", 0)? * 1024;
        Some(line("/proc/self/limits", "Max address space", 0)?.saturating_sub(taken))
    };
    [machine.or(Some(8 << 30)), container(), process()]
        .into_iter()
        .flatten()
        .min()
        .unwrap_or_default()
}
