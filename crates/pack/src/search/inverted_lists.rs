//! Entries sorted into the lists of an inverted file.

/// The order of entries by their list, and where each list starts in it, with the total at the end (`lists + 1`). Entries of a list stay
/// in their order.
pub fn sort_by_list(lists_of_entries: &[u32], lists: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; lists + 1];
    for &list in lists_of_entries {
        starts[list as usize + 1] += 1;
    }
    for list in 0..lists {
        starts[list + 1] += starts[list];
    }
    let mut order: Vec<u32> = (0..lists_of_entries.len() as u32).collect();
    order.sort_by_key(|&i| lists_of_entries[i as usize]);
    (order, starts)
}

/// Whether these are the starts of so many lists with so many entries together.
pub fn are_starts(starts: &[u32], lists: usize, entries: usize) -> bool {
    starts.len() == lists + 1
        && starts[0] == 0
        && starts.is_sorted()
        && starts[lists] as usize == entries
}
