//! Memory of this process, as Linux tells it (proc(5)).

/// Resident memory, MiB.
#[derive(Debug, Clone, Copy)]
pub struct Memory {
    /// Now.
    pub now_mib: u64,
    /// The most since the process began, or since [`forget_peak`].
    pub peak_mib: u64,
}

/// Resident memory; `None` where the system does not tell.
pub fn now() -> Option<Memory> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mib = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        let kib: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
        Some(kib >> 10)
    };
    Some(Memory {
        now_mib: mib("VmRSS:")?,
        peak_mib: mib("VmHWM:")?,
    })
}

/// The peak is counted from now on. Where the system refuses that, it stays that of the whole process, which is larger.
pub fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
