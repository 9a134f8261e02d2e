//! The paper's table 5: how often the right tile is among the first K.

use grimnet_eval::metrics::rank_distance::{FrameDistances, RankDistance};
use grimnet_eval::metrics::recall::{FrameRecall, Recall};
use grimnet_eval::scene::Scene;

use crate::bench::{Bench, BenchError, Measured};
use crate::experiment::Experiment;
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::recipe::{Recipe, Variant};
use crate::scene_rows::{INPUTS_NOTE, over, table};

/// K of table 5.
const RECALL_K: [usize; 6] = [1, 2, 3, 5, 8, 10];

pub(super) fn top_k_recall(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
) -> Result<ExperimentTable, BenchError> {
    let mut rows = Vec::new();
    for variant in Variant::SWEPT {
        let measured = over(bench, scenes, |scene| {
            let mut setup = variant.setup(scene)?;
            setup.options.top_k = setup.options.top_k.max(RECALL_K[RECALL_K.len() - 1]);
            Ok(setup)
        })?;
        rows.extend(rows_of(&variant.name(bench.model()), variant, &measured));
    }
    let columns: Vec<Column> = RECALL_K
        .map(|k| Column::percent(format!("K = {k}")))
        .to_vec();
    Ok(ExperimentTable {
        columns: columns.clone(),
        rows,
        paper_columns: columns,
        paper: vec![Row::new(
            "Recall@K, centre within 64 px",
            [82.3, 86.9, 89.7, 92.2, 92.8, 93.1].map(Some).to_vec(),
        )],
        notes: vec![
            INPUTS_NOTE.to_owned(),
            "SDM@K (Dai et al. 2024) and PDM@K (Ye et al. 2026) score each of the first K tiles by its distance from the truth, the earlier ranks more.".to_owned(),
            "At a stride of 256 px only a fifth of all places has any tile centre within 64 px: the paper's figures cannot be reached with its own tiling.".to_owned(),
        ],
        ..table(Experiment::TopKRecall.id(), "Recall for K candidates", 5, scenes)
    })
}

/// The rows of one variant; the paper's procedure has no vote.
fn rows_of(name: &str, variant: Variant, measured: &[Measured]) -> Vec<Row> {
    let join = |ranks: fn(&Measured) -> &Vec<FrameRecall>| {
        let all: Vec<_> = measured
            .iter()
            .flat_map(|m| ranks(m).iter().copied())
            .collect();
        Recall::of(&all, &RECALL_K)
    };
    let (near, covers) = (join(|m| &m.near), join(|m| &m.covers));
    let distances: Vec<FrameDistances> =
        measured.iter().flat_map(|m| m.distances.clone()).collect();
    let by_distance = RankDistance::of(&distances, &RECALL_K);
    let row = |what: &str, shares: &[f64]| {
        let values = shares.iter().map(|s| Some(100.0 * s)).collect();
        Row::new(format!("{what}, {name}"), values)
    };
    let mut rows = vec![
        row(
            "by descriptor, centre within 64 px of the truth",
            &near.by_descriptor,
        ),
        row(
            "by descriptor, tile covers the truth",
            &covers.by_descriptor,
        ),
        row("by descriptor, SDM@K", &by_distance.sdm_by_descriptor),
        row("by descriptor, PDM@K", &by_distance.pdm_by_descriptor),
    ];
    if variant.recipe == Recipe::Default {
        rows.extend([
            row("after the vote, tile covers the truth", &covers.by_vote),
            row("after the vote, SDM@K", &by_distance.sdm_by_vote),
            row("after the vote, PDM@K", &by_distance.pdm_by_vote),
        ]);
    }
    rows
}
