//! `SECURITY.md` states the defaults.

use grimnet_limits::{Limits, size};

#[test]
fn security_md_states_every_default() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../SECURITY.md");
    let page = std::fs::read_to_string(path).unwrap();
    let rows: Vec<String> = Limits::default()
        .rows()
        .iter()
        .map(|(name, value)| format!("| {name} | {value} |\n"))
        .collect();
    let table = format!("| limit | default |\n|---|---|\n{}\n", rows.concat());
    assert!(page.contains(&table), "SECURITY.md should hold:\n{table}");
}

#[test]
fn sizes_are_short() {
    assert_eq!(size(1 << 30), "1 GiB");
    assert_eq!(size(3 << 29), "1.5 GiB");
    assert_eq!(size(100_000), "0.1 MiB");
}
