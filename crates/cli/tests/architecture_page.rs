//! `ARCHITECTURE.md` says which crate builds on which, as the `Cargo.toml` files do.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// What each crate builds on.
type Graph = BTreeMap<String, BTreeSet<String>>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The name of a crate's folder: `geo` of `grimnet-geo`.
fn folder_of(package: &str) -> Option<String> {
    match package.strip_prefix("grimnet") {
        Some("") => Some("grimnet".to_owned()),
        Some(rest) => rest.strip_prefix('-').map(str::to_owned),
        None => None,
    }
}

/// The dependencies between the crates of the workspace, optional ones included, those of tests not.
fn manifests() -> Graph {
    let mut graph = Graph::new();
    for entry in std::fs::read_dir(root().join("crates")).unwrap() {
        let path = entry.unwrap().path();
        let Ok(text) = std::fs::read_to_string(path.join("Cargo.toml")) else {
            continue;
        };
        let manifest: toml::Table = text.parse().unwrap();
        let needed = manifest.get("dependencies").and_then(|d| d.as_table());
        let needed = needed.into_iter().flat_map(|table| table.keys());
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        graph.insert(name, needed.filter_map(|name| folder_of(name)).collect());
    }
    assert!(graph.len() > 20, "{graph:?}");
    graph
}

/// The rows of the page: the crates of each, from the programs down, with what they build on.
fn rows(page: &str) -> Vec<Graph> {
    let (_, block) = page.split_once("## Who builds on whom").unwrap();
    let block = block.split("```").nth(1).unwrap();
    let rows = block.lines().filter(|line| line.len() > 17).map(|line| {
        let mut row = Graph::new();
        for part in line[17..].split("   ").map(str::trim) {
            let (name, needed) = part.split_once(" [").unwrap_or((part, ""));
            let needed = needed.trim_end_matches(']').split_whitespace();
            let needed = needed.map(|name| name.trim_end_matches('*').to_owned());
            row.insert(name.to_owned(), needed.collect());
        }
        row
    });
    rows.collect()
}

/// All that a crate builds on, directly or through others.
fn reached(graph: &Graph, from: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut open = vec![from.to_owned()];
    while let Some(name) = open.pop() {
        let needed = graph.get(&name).into_iter().flatten();
        open.extend(needed.filter(|name| found.insert((*name).clone())).cloned());
    }
    found
}

#[test]
fn the_page_has_every_crate_and_what_it_builds_on() {
    let page = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let manifests = manifests();
    let rows = rows(&page);
    let drawn: Graph = rows
        .iter()
        .flatten()
        .map(|(n, d)| (n.clone(), d.clone()))
        .collect();
    let beside = "fuzz".to_owned();
    let named: BTreeSet<&String> = drawn.keys().chain([&beside]).collect();
    assert_eq!(named, manifests.keys().collect());
    for (name, needed) in &drawn {
        assert_eq!(reached(&drawn, name), reached(&manifests, name), "{name}");
        let direct = &manifests[name];
        assert!(needed.is_subset(direct), "{name}: {needed:?} of {direct:?}");
        for one in needed {
            let others = needed.iter().filter(|other| *other != one);
            let through = others.flat_map(|other| reached(&drawn, other));
            assert!(
                !through.into_iter().any(|other| other == *one),
                "{name} has {one} twice"
            );
        }
    }
    for name in manifests.keys() {
        let package = match name.as_str() {
            "grimnet" => "| `grimnet` |".to_owned(),
            _ => format!("| `grimnet-{name}`"),
        };
        assert!(page.contains(&package), "the table of crates has no {name}");
    }
}

#[test]
fn a_crate_builds_on_rows_below_it() {
    let page = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let rows = rows(&page);
    for (number, row) in rows.iter().enumerate() {
        for (name, needed) in row {
            let below = |one: &String| rows[number + 1..].iter().any(|row| row.contains_key(one));
            assert!(needed.iter().all(below), "{name}: {needed:?}");
        }
    }
}
