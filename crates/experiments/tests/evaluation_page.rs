//! EVALUATION.md says what the stored figures say.

#![allow(clippy::unwrap_used)]

use std::path::Path;

#[test]
fn the_page_and_the_stored_figures_agree() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let made = grimnet_experiments::claims::page(&root.join("evaluation")).unwrap();
    let kept = std::fs::read_to_string(root.join("EVALUATION.md")).unwrap();
    for (line, (made, kept)) in (1..).zip(made.lines().zip(kept.lines())) {
        assert_eq!(
            made, kept,
            "EVALUATION.md, line {line}: run `cargo run -p grimnet-experiments --example evaluation`"
        );
    }
    assert_eq!(made.lines().count(), kept.lines().count());
}
