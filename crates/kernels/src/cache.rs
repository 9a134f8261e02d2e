//! Sizes of the processor's caches, by which the kernels choose their blocks. Blocks change the time only, never a result.

use std::sync::OnceLock;

/// Assumed where the size cannot be found out, bytes: what a core of the smaller processors in use has.
const ASSUMED_L2_BYTES: usize = 512 << 10;
/// Sizes outside of this range are implausible, bytes.
const PLAUSIBLE_L2_BYTES: std::ops::RangeInclusive<usize> = 128 << 10..=4 << 20;

/// Bytes of the L2 cache that one core may use, as the processor or the operating system states it.
pub(crate) fn l2_bytes() -> usize {
    static BYTES: OnceLock<usize> = OnceLock::new();
    *BYTES.get_or_init(|| {
        stated_l2_bytes()
            .filter(|bytes| PLAUSIBLE_L2_BYTES.contains(bytes))
            .unwrap_or(ASSUMED_L2_BYTES)
    })
}

/// From the deterministic cache parameters: leaf 4 of Intel (Software Developer's Manual, volume 2A, CPUID), leaf 0x8000_001D of AMD
/// (Architecture Programmer's Manual, volume 3, appendix E.4.15), which have the same layout.
#[cfg(target_arch = "x86_64")]
fn stated_l2_bytes() -> Option<usize> {
    use std::arch::x86_64::{__cpuid, __cpuid_count};
    /// More caches than any processor lists.
    const MOST_CACHES: u32 = 16;

    let leaf_exists = |leaf: u32| __cpuid(leaf & 0x8000_0000).eax >= leaf;
    [4, 0x8000_001D].into_iter().find_map(|leaf| {
        if !leaf_exists(leaf) {
            return None;
        }
        (0..MOST_CACHES)
            .map(|cache| __cpuid_count(leaf, cache))
            .take_while(|cache| cache.eax & 0x1F != 0)
            .find(|cache| cache.eax >> 5 & 0x7 == 2)
            .map(|cache| {
                let ways = (cache.ebx >> 22) + 1;
                let partitions = (cache.ebx >> 12 & 0x3FF) + 1;
                let line_bytes = (cache.ebx & 0xFFF) + 1;
                let sets = cache.ecx + 1;
                ways as usize * partitions as usize * line_bytes as usize * sets as usize
            })
    })
}

/// As Linux states it for the first core, shared between the cores that share the cache.
#[cfg(not(target_arch = "x86_64"))]
fn stated_l2_bytes() -> Option<usize> {
    let read = |name: &str| {
        std::fs::read_to_string(format!("/sys/devices/system/cpu/cpu0/cache/index2/{name}")).ok()
    };
    let kib: usize = read("size")?.trim().strip_suffix('K')?.parse().ok()?;
    let cores = read("shared_cpu_list").map_or(1, |list| cores_in(list.trim()));
    Some((kib << 10) / cores.max(1))
}

/// Number of cores in a list such as `0-3,8`.
#[cfg(any(test, not(target_arch = "x86_64")))]
fn cores_in(list: &str) -> usize {
    let count = |part: &str| -> Option<usize> {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let [first, last]: [usize; 2] = [first.parse().ok()?, last.parse().ok()?];
        (last + 1).checked_sub(first)
    };
    list.split(',').filter_map(count).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_is_plausible() {
        assert!(PLAUSIBLE_L2_BYTES.contains(&l2_bytes()), "{}", l2_bytes());
    }

    #[test]
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    fn the_processor_and_the_operating_system_agree() {
        let path = "/sys/devices/system/cpu/cpu0/cache/index2";
        // Containers and some hypervisors hide it.
        let Ok(size) = std::fs::read_to_string(format!("{path}/size")) else {
            return;
        };
        let kib: usize = size.trim().trim_end_matches('K').parse().unwrap();
        assert_eq!(stated_l2_bytes(), Some(kib << 10));
    }

    #[test]
    fn cores_are_counted() {
        assert_eq!(cores_in("0"), 1);
        assert_eq!(cores_in("0-3"), 4);
        assert_eq!(cores_in("0-1,8-9,12"), 5);
        assert_eq!(cores_in(""), 0);
    }
}
