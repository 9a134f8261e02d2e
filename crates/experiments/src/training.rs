//! Experiments that train networks, on small budgets: loss weights (the paper's table 3), retrieval and matching trained apart (its
//! table 4), and one normalisation for both domains in place of DA-BN (its table 10).

use std::path::Path;

use grimnet_train::{Norms, Weights};

use crate::bench::{Bench, BenchError, Measured};
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::networks::{Networks, NetworksError};
use crate::scene_rows::{
    PAPER_DA_BN, PAPER_MODULES, ale, all_frames, mean, over, paper_scenes, scene_row, table,
};
use crate::tables::{PAPER_K, Recipe};
use grimnet_eval::metrics::Summary;
use grimnet_eval::scene::Scene;

/// Name of the network with nothing changed, which all experiments share.
const UNCHANGED: &str = "default";

/// The paper's names of the weights that table 3 varies (section 3.6).
const WEIGHT_NAMES: [&str; 4] = ["alpha", "beta 1", "beta 2", "gamma"];

/// Factors on each weight in table 3.
const FACTORS: [f32; 2] = [0.5, 2.0];

/// The paper's table 3: average error, metres, in the order of [`weightings`].
const PAPER_LOSS_WEIGHTS_M: [f64; 9] = [
    14.72, 16.58, 16.09, 17.25, 17.51, 16.17, 16.46, 16.54, 16.41,
];

/// The experiments that train.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TrainedExperiment {
    /// Table 3: each loss weight halved and doubled.
    LossWeights,
    /// Table 4: G + M, two independent networks, compared with G + M + L.
    Modules,
    /// Table 10: DA-BN compared with one normalisation for both domains.
    DaBn,
}

/// Why an experiment with training cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// A network.
    #[error(transparent)]
    Networks(#[from] NetworksError),
    /// Measuring.
    #[error(transparent)]
    Bench(Box<BenchError>),
}

impl From<BenchError> for TrainingError {
    fn from(error: BenchError) -> Self {
        Self::Bench(Box::new(error))
    }
}

/// Runs an experiment: trains the networks that it compares, or opens them if they are finished, and measures each on all scenes;
/// packs are written to `packs`.
///
/// # Errors
/// Training or measuring fails, or was stopped.
pub fn run(
    experiment: TrainedExperiment,
    networks: &Networks,
    packs: &Path,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, TrainingError> {
    let mut made = match experiment {
        TrainedExperiment::LossWeights => loss_weights(networks, packs, scenes, recipe),
        TrainedExperiment::Modules => modules(networks, packs, scenes, recipe),
        TrainedExperiment::DaBn => da_bn(networks, packs, scenes, recipe),
    }?;
    made.notes.push(networks.describe());
    Ok(made)
}

/// Columns of table 3: name, weight and factor.
fn weightings() -> Vec<(String, usize, f32)> {
    let changed = FACTORS.iter().flat_map(|&factor| {
        WEIGHT_NAMES
            .iter()
            .enumerate()
            .map(move |(i, name)| (format!("{name} x {factor:.1}"), i, factor))
    });
    std::iter::once((UNCHANGED.to_owned(), 0, 1.0))
        .chain(changed)
        .collect()
}

/// The weight with this place in [`WEIGHT_NAMES`].
fn weight(weights: &mut Weights, index: usize) -> &mut f32 {
    match index {
        0 => &mut weights.global,
        1 => &mut weights.keypoint,
        2 => &mut weights.descriptor,
        _ => &mut weights.homography,
    }
}

fn loss_weights(
    networks: &Networks,
    packs: &Path,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, TrainingError> {
    let mut rows = [
        ("Average ALE, m", Vec::new()),
        ("Within 20 m, %", Vec::new()),
        ("Within 5 m, %", Vec::new()),
    ];
    for (name, index, factor) in weightings() {
        let model = networks.get(&name, |config| {
            *weight(&mut config.weights, index) *= factor
        })?;
        let measured = over(&mut Bench::new(&model, packs)?, scenes, &recipe.setup())?;
        let summary = Summary::of(&all_frames(&measured));
        let average_m = mean(&measured.iter().map(ale).collect::<Vec<_>>());
        rows[0].1.push(average_m);
        rows[1].1.push(Some(100.0 * summary.within_20m));
        rows[2].1.push(Some(100.0 * summary.within_5m));
    }
    let columns: Vec<Column> = weightings()
        .iter()
        .map(|(name, ..)| Column::new(name.as_str(), "", 2))
        .collect();
    Ok(ExperimentTable {
        columns: columns.clone(),
        rows: rows.map(|(name, values)| Row::new(name, values)).to_vec(),
        paper_columns: columns,
        paper: vec![Row::new(
            "Average ALE, m",
            PAPER_LOSS_WEIGHTS_M.map(Some).to_vec(),
        )],
        ..table(
            "loss-weights",
            "Error under several weights of the losses",
            3,
            scenes,
        )
    })
}

fn modules(
    networks: &Networks,
    packs: &Path,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, TrainingError> {
    let retrieval = networks.get("retrieval alone", |config| {
        let weights = &mut config.weights;
        (weights.keypoint, weights.descriptor, weights.homography) = (0.0, 0.0, 0.0);
    })?;
    let matching = networks.get("matching alone", |config| config.weights.global = 0.0)?;
    let joint = networks.get(UNCHANGED, |_| {})?;
    let finder = Bench::new(&retrieval, packs)?;
    let matcher = Bench::new(&matching, packs)?;
    let setup = recipe.setup();
    let apart: Vec<Measured> = scenes
        .iter()
        .map(|scene| matcher.measure_apart(&finder, scene, &setup, PAPER_K))
        .collect::<Result<_, _>>()?;
    let together = over(&mut Bench::new(&joint, packs)?, scenes, &setup)?;
    let (paper_columns, paper) = paper_scenes(&PAPER_MODULES);
    let mut made = table(
        "modules-trained",
        "Retrieval and matching trained apart and together",
        4,
        scenes,
    );
    made.notes.push(
        "G + M: one network was trained for retrieval alone and one for matching alone, with the budget of the joint network each. The matching network \
         runs once for each retrieved tile; its time counts that."
            .into(),
    );
    Ok(ExperimentTable {
        rows: vec![
            scene_row("G + M", &apart),
            scene_row("G + M + L", &together),
        ],
        paper_columns,
        paper,
        ..made
    })
}

fn da_bn(
    networks: &Networks,
    packs: &Path,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, TrainingError> {
    let mut rows = Vec::new();
    for (name, network, norms) in [
        ("GRiM-Net", UNCHANGED, Norms::ByDomain),
        ("without DA-BN", "plain BN", Norms::Joint),
    ] {
        let model = networks.get(network, |config| config.norms = norms)?;
        let measured = over(&mut Bench::new(&model, packs)?, scenes, &recipe.setup())?;
        rows.push(scene_row(name, &measured));
    }
    let (paper_columns, paper) = paper_scenes(&PAPER_DA_BN);
    Ok(ExperimentTable {
        rows,
        paper_columns,
        paper,
        ..table(
            "da-bn-trained",
            "Normalisation by domain, trained",
            10,
            scenes,
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_3_has_the_papers_columns_in_its_order() {
        let names: Vec<String> = weightings().into_iter().map(|(name, ..)| name).collect();
        assert_eq!(names.len(), PAPER_LOSS_WEIGHTS_M.len());
        assert_eq!(
            names,
            [
                "default",
                "alpha x 0.5",
                "beta 1 x 0.5",
                "beta 2 x 0.5",
                "gamma x 0.5",
                "alpha x 2.0",
                "beta 1 x 2.0",
                "beta 2 x 2.0",
                "gamma x 2.0"
            ]
        );
        let mut weights = Weights::default();
        for i in 0..WEIGHT_NAMES.len() {
            *weight(&mut weights, i) = i as f32;
        }
        assert_eq!(
            (
                weights.global,
                weights.keypoint,
                weights.descriptor,
                weights.homography
            ),
            (0.0, 1.0, 2.0, 3.0)
        );
    }
}
