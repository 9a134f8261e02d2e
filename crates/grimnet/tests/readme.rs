//! The example of the readme files is the one that the documentation of the crate compiles.

#![allow(clippy::unwrap_used)]

use std::path::Path;

/// The code of the first Rust block.
fn rust_block(markdown: &str) -> Vec<&str> {
    let (_, rest) = markdown.split_once("```rust\n").unwrap();
    rest.split_once("```").unwrap().0.lines().collect()
}

#[test]
fn readme_examples_are_compiled() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let documentation = std::fs::read_to_string(root.join("src/lib.rs")).unwrap();
    let (_, rest) = documentation.split_once("//! ```no_run\n").unwrap();
    let compiled: Vec<&str> = rest
        .split_once("//! ```")
        .unwrap()
        .0
        .lines()
        .map(|line| line.trim_start_matches("//!").trim_start_matches(' '))
        .filter(|line| !line.starts_with('#'))
        .collect();
    for file in ["README.md", "../../README.md"] {
        let Ok(readme) = std::fs::read_to_string(root.join(file)) else {
            // A published package does not hold the readme of the repository.
            assert_ne!(file, "README.md");
            continue;
        };
        let block: Vec<&str> = rust_block(&readme).iter().map(|line| line.trim()).collect();
        assert!(block.len() > 5);
        assert_eq!(block, compiled, "{file}");
    }
}
