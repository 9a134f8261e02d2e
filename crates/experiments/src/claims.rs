//! EVALUATION.md: the published figures of accuracy, made from stored `summary.json` files.
//!
//! A folder holds one folder a claim, with `claim.json` ([`Claim`]), the `summary.json` that `grim eval` wrote and, where they are to be
//! shown, its `recall.json` (ranks of the right tile) and `elsewhere.json` (photos that are not on the map), and
//! `tracks/` ([`crate::track_claims`]), `experiments/`, with the tables of `grim-experiments`, and `paper.md`, the table of
//! what follows the publication and what differs. The page is made by
//! `cargo run -p grimnet-experiments --example evaluation`; a test fails if the page and the stored figures differ.

use std::fmt::Write as _;
use std::path::Path;

use crate::claim::Claim;
use crate::claim_section::{Figures, section};
use crate::experiment_table::ExperimentTable;
use crate::stored::{ClaimError, read, sorted};
use crate::track_claims;

const HEAD: &str = "\
# Evaluation

Made from the stored figures under `evaluation/` by `cargo run -p grimnet-experiments --example evaluation`; do not edit. Shares are of
all photos; a photo without a fix is a miss. \"Behind\" marks figures of this program that are worse than another system's on the same photos.
";

/// From the page to the curves of the experiments.
const FIGURES: &str = "evaluation/experiments/";

/// The table "the paper and this program", kept by hand.
const PAPER_TABLE: &str = "paper.md";

/// The page for the claims stored in `folder`.
///
/// # Errors
/// A stored file is missing or of another form.
pub fn page(folder: &Path) -> Result<String, ClaimError> {
    let mut page = HEAD.to_owned();
    for folder in sorted(folder)?
        .iter()
        .filter(|path| path.join("claim.json").is_file())
    {
        let claim: Claim = read(&folder.join("claim.json"))?;
        let if_there = |name: &str| {
            let path = folder.join(name);
            path.is_file().then(|| read(&path)).transpose()
        };
        let figures = Figures {
            summary: read(&folder.join("summary.json"))?,
            recall: if_there("recall.json")?,
            elsewhere: if_there("elsewhere.json")?,
        };
        section(&mut page, &claim, &figures);
    }
    let tracks = folder.join("tracks");
    if tracks.is_dir() {
        page.push_str(&track_claims::sections(&tracks)?);
    }
    let paper = folder.join(PAPER_TABLE);
    if paper.is_file() {
        let _ = write!(page, "\n{}", fs_err::read_to_string(&paper)?);
    }
    let experiments = folder.join("experiments");
    if experiments.is_dir() {
        page.push_str("\n## The paper's experiments and sweeps\n");
        for path in sorted(&experiments)? {
            if path.extension().is_some_and(|e| e == "json") {
                let _ = write!(
                    page,
                    "\n{}",
                    ExperimentTable::read(&path)?.to_markdown(FIGURES)
                );
            }
        }
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claim::Peer;

    #[test]
    fn worse_figures_are_called_behind_and_better_ones_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let claim = folder.path().join("a");
        fs_err::create_dir_all(&claim).unwrap();
        let peer = |name: &str, within_5m, median_m| Peer {
            name: name.into(),
            run: "heading_known".into(),
            within_5m,
            within_10m: 0.9,
            within_20m: 0.9,
            median_m,
            source: "measured elsewhere".into(),
        };
        let text = serde_json::to_string(&Claim {
            title: "A".into(),
            data: "b".into(),
            command: "c".into(),
            peers: vec![peer("Worse", 0.5, 9.0), peer("Better", 0.95, 1.04)],
            remarks: vec![],
        })
        .unwrap();
        fs_err::write(claim.join("claim.json"), text).unwrap();
        let summary = r#"{"about":{"mode":"default"},"heading_known":{"frames":10,"fixes":9,"within_5m":0.9,
            "within_10m":0.9,"within_20m":0.9,"median_m":1.01,
            "footprint":{"answerable":8,"answerable_fixes":7,"right":6,"right_share_interval":[0.4,0.9],"places":3,
                "wrong":1,"undecided":0},
            "reliability":{"bins":[{"from":0.9,"to":0.97,"fixes":7,"mean_confidence":0.95,"right":6,
                "right_share_interval":[0.5,0.99],"places":1}]}}}"#;
        fs_err::write(claim.join("summary.json"), summary).unwrap();
        let tried = r#"{"all":{"name":"all trials","trials":900,"fixes":1,"share_interval":[0.0002,0.0063],"pictures":9},
            "by_source":[{"name":"coast","trials":900,"fixes":1,"share_interval":[0.0002,0.0063],"pictures":9}]}"#;
        fs_err::write(claim.join("elsewhere.json"), tried).unwrap();
        let ranks = r#"[{"run":"heading known","gallery_tiles":4100,"covers":{"frames":10,"at":[1,5],
            "by_descriptor":[0.5,0.6],"by_vote":[0.7,0.8],"matched":0.9},"near":{}}]"#;
        fs_err::write(claim.join("recall.json"), ranks).unwrap();
        let page = page(folder.path()).unwrap();
        for row in [
            "| heading known, 4100 tiles, by descriptor | 50 % | 60 % | 90 % |",
            "| heading known, 4100 tiles, after the vote | 70 % | 80 % | 90 % |",
        ] {
            assert!(page.contains(row), "{page}");
        }
        for name in ["all trials", "coast"] {
            let row = format!("| {name} | 900 | 1 | 0.02 % to 0.63 %, 9 pictures |");
            assert!(page.contains(&row), "{page}");
        }
        assert!(page.contains("behind Better (within 5 m) |"), "{page}");
        assert!(!page.contains("behind Worse"), "{page}");
        assert!(page.contains("| 9 of 10 |"), "{page}");
        let shares = "| heading known: 8 | 7 | 6 | 40 % to 90 %, 3 places | 1 | 0 |";
        assert!(page.contains(shares), "{page}");
        let bin = "| heading known | 90 % to 97 % | 7 | 95 % | 6 | 50 % to 99 %, 1 place |";
        assert!(page.contains(bin), "{page}");
        fs_err::write(claim.join("summary.json"), "{").unwrap();
        let error = super::page(folder.path()).unwrap_err().to_string();
        assert!(error.contains("summary.json"), "{error}");
    }
}
