//! EVALUATION.md says what the stored figures say.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
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

/// Rows of the tables of evaluation/paper.md whose head is `equation or section`: their cells.
fn rows(text: &str) -> Vec<Vec<&str>> {
    let mut rows = Vec::new();
    let mut is_inside = false;
    for line in text.lines() {
        if !line.starts_with('|') {
            is_inside = false;
        } else if line.starts_with("| equation or section |") {
            is_inside = true;
        } else if is_inside && !line.starts_with("|---") {
            let cells = line.trim_matches('|').split('|').map(str::trim);
            rows.push(cells.collect());
        }
    }
    rows
}

/// The equations that a text names, as `eq. 3`, `eq. 2a` or `eq. 5-7`.
fn equations(text: &str) -> BTreeSet<u32> {
    let number = |text: &str| -> Option<u32> {
        let end = text.find(|c: char| !c.is_ascii_digit());
        text[..end.unwrap_or(text.len())].parse().ok()
    };
    let mut named = BTreeSet::new();
    for rest in text.to_lowercase().split("eq. ").skip(1) {
        let Some(first) = number(rest) else {
            continue;
        };
        let after = rest.trim_start_matches(|c: char| c.is_ascii_digit());
        let last = after.strip_prefix('-').and_then(number);
        named.extend(first..=last.unwrap_or(first));
    }
    named
}

/// The paper numbers its equations from 1 to 25.
#[test]
fn every_equation_of_the_paper_is_named_in_a_file_that_its_row_names() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("evaluation/paper.md")).unwrap();
    let mut all = BTreeSet::new();
    for row in rows(&text) {
        let files: Vec<&str> = row[2]
            .split('`')
            .filter(|name| name.contains('/'))
            .collect();
        let named: BTreeSet<u32> = files
            .iter()
            .flat_map(|file| equations(&std::fs::read_to_string(root.join(file)).unwrap()))
            .collect();
        let listed = equations(row[0]);
        assert!(
            listed.is_subset(&named),
            "{listed:?}, but {files:?} name {named:?}"
        );
        all.extend(listed);
    }
    assert_eq!(all, (1..=25).collect::<BTreeSet<u32>>());
}

#[test]
fn every_row_of_the_table_of_the_paper_names_its_source_an_existing_file_and_what_differs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("evaluation/paper.md")).unwrap();
    let rows = rows(&text);
    assert!(rows.len() > 30, "{} rows", rows.len());
    for row in rows {
        let [source, paper, ours, differs] = row[..] else {
            panic!("{} cells in {row:?}", row.len());
        };
        let has_source = source == "-" || source.contains(|c: char| c.is_ascii_digit());
        assert!(
            has_source && !paper.is_empty() && !differs.is_empty(),
            "{row:?}"
        );
        let files: Vec<&str> = ours
            .split('`')
            .skip(1)
            .step_by(2)
            .filter(|name| name.contains('/') || name.ends_with(".rs"))
            .collect();
        assert!(!files.is_empty(), "no file in {row:?}");
        for file in files {
            assert!(root.join(file).is_file(), "no file {file}: {row:?}");
        }
    }
}
