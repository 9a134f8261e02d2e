//! Every dependency's licence must allow what ours (MIT OR Apache-2.0) promises.

use std::process::Command;

use spdx::{Expression, LicenseItem, LicenseReq};

/// Permissive licences, and weak copyleft that stays within its own files.
const ALLOWED: &[&str] = &[
    "0BSD",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "CDLA-Permissive-2.0",
    "ISC",
    "MIT",
    "MIT-0",
    "MPL-2.0",
    "NCSA",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Packages that state their licence in a file alone, which was read: Apache-2.0.
const READ: &[(&str, &str)] = &[("cfg_block", "0.1.1")];

fn allowed(requirement: &LicenseReq) -> bool {
    match &requirement.license {
        LicenseItem::Spdx { id, .. } => ALLOWED.contains(&id.name),
        LicenseItem::Other { .. } => false,
    }
}

#[test]
fn every_dependency_may_be_shipped() {
    // Only what is built here has been downloaded.
    let rustc = Command::new("rustc").arg("-vV").output().unwrap();
    let rustc = String::from_utf8(rustc.stdout).unwrap();
    let host = rustc
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .unwrap();
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", host])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    assert!(packages.len() > 50, "the dependency graph is there");
    let refused: Vec<String> = packages
        .iter()
        .filter_map(|package| {
            let (name, version) = (package["name"].as_str()?, package["version"].as_str()?);
            if READ.contains(&(name, version)) {
                return None;
            }
            let name = format!("{name} {version}");
            let Some(licence) = package["license"].as_str() else {
                return Some(format!("{name}: states no licence"));
            };
            match Expression::parse_mode(licence, spdx::ParseMode::LAX) {
                Ok(expression) if expression.evaluate(allowed) => None,
                _ => Some(format!("{name}: {licence}")),
            }
        })
        .collect();
    assert!(refused.is_empty(), "not allowed:\n{}", refused.join("\n"));
}
