//! Checks every dependency against `deny.toml` with cargo alone: licences, banned packages, sources.
//! `cargo deny check licenses bans sources` reads the same file and checks more.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use spdx::{Expression, LicenseItem, LicenseReq, ParseMode};

/// The registry that Cargo.lock names for packages of the public registry.
const PUBLIC_REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";

fn workspace_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read_toml(name: &str) -> toml::Table {
    let path = workspace_root().join(name);
    let text = fs_err::read_to_string(path).unwrap();
    text.parse().unwrap()
}

/// The strings `key` of the tables (or the strings themselves) in the list `section.list` of deny.toml.
fn listed(deny: &toml::Table, section: &str, list: &str, key: &str) -> Vec<String> {
    let Some(items) = deny[section].get(list) else {
        return Vec::new();
    };
    let items = items.as_array().unwrap().iter();
    items
        .map(|item| item.get(key).unwrap_or(item).as_str().unwrap().to_owned())
        .collect()
}

/// Packages that a build on this machine uses, as `cargo metadata` describes them.
fn packages() -> Vec<Value> {
    let rustc = Command::new("rustc").arg("-vV").output().unwrap();
    let rustc = String::from_utf8(rustc.stdout).unwrap();
    let host = rustc
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .unwrap();
    // Only packages for this platform have been downloaded.
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", host])
        .current_dir(workspace_root())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let mut metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let Value::Array(packages) = metadata["packages"].take() else {
        panic!("cargo metadata lists no packages");
    };
    assert!(
        packages.len() > 50,
        "{} packages are too few",
        packages.len()
    );
    packages
}

fn name_version(package: &Value) -> String {
    format!(
        "{}@{}",
        package["name"].as_str().unwrap(),
        package["version"].as_str().unwrap()
    )
}

#[test]
fn licences_are_allowed() {
    let deny = read_toml("deny.toml");
    let allowed = listed(&deny, "licenses", "allow", "name");
    let clarified = listed(&deny, "licenses", "clarify", "crate");
    let is_allowed = |requirement: &LicenseReq| match &requirement.license {
        LicenseItem::Spdx { id, .. } => allowed.iter().any(|name| name == id.name),
        LicenseItem::Other { .. } => false,
    };
    let refused: Vec<String> = packages()
        .iter()
        .filter(|package| !clarified.contains(&name_version(package)))
        .filter_map(|package| {
            let name = name_version(package);
            let Some(licence) = package["license"].as_str() else {
                return Some(format!("{name}: states no licence"));
            };
            match Expression::parse_mode(licence, ParseMode::LAX) {
                Ok(expression) if expression.evaluate(is_allowed) => None,
                _ => Some(format!("{name}: {licence}")),
            }
        })
        .collect();
    assert!(refused.is_empty(), "not allowed:\n{}", refused.join("\n"));
}

/// What `cargo tree` prints of the packages that are built: `cargo metadata` lists optional packages as well.
fn tree(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--workspace", "--locked", "--offline"])
        .args(["--edges", "normal,build,dev"])
        .args(arguments)
        .current_dir(workspace_root())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn no_banned_package_is_built() {
    let deny = read_toml("deny.toml");
    let banned = deny["bans"]["deny"].as_array().unwrap();
    assert!(!banned.is_empty());
    // Depth and name: what is one deeper depends on it.
    let built = tree(&["--prefix", "depth", "--format", " {p}", "--no-dedupe"]);
    assert!(built.lines().count() > 50, "{built}");
    let mut above: Vec<&str> = Vec::new();
    let mut found = std::collections::BTreeSet::new();
    for line in built.lines().filter(|line| !line.is_empty()) {
        let mut words = line.split(' ');
        let depth: usize = words.next().unwrap().parse().unwrap();
        let name = words.next().unwrap();
        above.truncate(depth);
        let parent = above.last().copied().unwrap_or_default();
        above.push(name);
        let Some(ban) = banned
            .iter()
            .find(|ban| ban["crate"].as_str() == Some(name))
        else {
            continue;
        };
        let allowed = ban.get("wrappers").is_some_and(|wrappers| {
            let mut wrappers = wrappers.as_array().unwrap().iter();
            wrappers.any(|wrapper| wrapper.as_str() == Some(parent))
        });
        if !allowed {
            found.insert(format!("{name} for {parent}"));
        }
    }
    assert!(found.is_empty(), "banned in deny.toml: {found:?}");
}

#[test]
fn no_banned_feature_is_built() {
    let deny = read_toml("deny.toml");
    let built = tree(&["--prefix", "none", "--format", "{p} {f}"]);
    for ban in deny["bans"]["features"].as_array().unwrap() {
        let name = ban["crate"].as_str().unwrap();
        let lines: Vec<&str> = built
            .lines()
            .filter(|line| line.split(' ').next() == Some(name))
            .collect();
        assert!(!lines.is_empty(), "{name} is not built");
        for feature in ban["deny"].as_array().unwrap() {
            let feature = feature.as_str().unwrap();
            let has = |line: &&&str| {
                let features = line.split(' ').nth(2).unwrap_or_default();
                features.split(',').any(|built| built == feature)
            };
            assert_eq!(lines.iter().find(has), None, "{name}: {feature}");
        }
    }
}

#[test]
fn every_package_comes_from_the_public_registry_with_a_checksum() {
    let deny = read_toml("deny.toml");
    assert_eq!(deny["sources"]["unknown-registry"].as_str(), Some("deny"));
    assert_eq!(deny["sources"]["unknown-git"].as_str(), Some("deny"));
    let lock = read_toml("Cargo.lock");
    let elsewhere: Vec<String> = lock["package"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|package| match package.get("source") {
            Some(source) => {
                source.as_str() != Some(PUBLIC_REGISTRY) || package.get("checksum").is_none()
            }
            // A member of the workspace.
            None => !package["name"].as_str().unwrap().starts_with("grimnet"),
        })
        .map(|package| format!("{} {:?}", package["name"], package.get("source")))
        .collect();
    assert!(elsewhere.is_empty(), "{}", elsewhere.join("\n"));
}
