//! Experiments that train networks, several seeds each: loss weights (the paper's table 3), retrieval and matching trained apart (its
//! table 4), and one normalisation for both domains in place of DA-BN (its table 10).

use std::path::Path;

use grimnet_train::{Norms, Weights};

use crate::bench::{Bench, BenchError, Measured};
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::networks::{Networks, NetworksError, Trained};
use crate::recipe::Variant;
use crate::scene_rows::{
    PAPER_DA_BN, PAPER_MODULES, ale, all_frames, mean, over, paper_scenes, scene_row, table,
};
use crate::tables::PAPER_K;
use grimnet_eval::metrics::Summary;
use grimnet_eval::scene::Scene;

/// The methods that the trained networks are measured with.
const VARIANTS: [Variant; 2] = [Variant::PAPER, Variant::DEFAULT_WITH_PRIOR];

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

impl TrainedExperiment {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::LossWeights, Self::Modules, Self::DaBn];

    /// Its name, also that of its table.
    #[must_use]
    pub fn id(self) -> &'static str {
        match self {
            Self::LossWeights => "loss-weights",
            Self::Modules => "modules-trained",
            Self::DaBn => "da-bn-trained",
        }
    }

    /// What it compares, in words.
    #[must_use]
    pub fn help(self) -> &'static str {
        match self {
            Self::LossWeights => {
                "Weights of the losses (table 3); trains nine networks for each seed"
            }
            Self::Modules => {
                "Retrieval and matching trained apart (table 4); trains three networks for each seed"
            }
            Self::DaBn => {
                "Plain batch normalisation in training (table 10); trains two networks for each seed"
            }
        }
    }
}

/// Why an experiment with training cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// A network.
    #[error(transparent)]
    Networks(#[from] NetworksError),
    /// A weight that is to be halved and doubled is zero.
    #[error(
        "the weight {name} of the configuration is 0: half and twice of it are the same network; set it in `[weights]`, or leave out --train-config"
    )]
    NoWeight {
        /// The weight, as in table 3.
        name: &'static str,
    },
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
) -> Result<ExperimentTable, TrainingError> {
    let mut made = match experiment {
        TrainedExperiment::LossWeights => loss_weights(networks, packs, scenes),
        TrainedExperiment::Modules => modules(networks, packs, scenes),
        TrainedExperiment::DaBn => da_bn(networks, packs, scenes),
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

/// Frames of several networks on the same scenes, together.
fn pooled(by_network: &[Vec<Measured>]) -> Vec<Measured> {
    let scenes = by_network.first().map_or(0, Vec::len);
    (0..scenes)
        .map(|scene| Measured {
            frames: by_network
                .iter()
                .flat_map(|measured| measured[scene].frames.clone())
                .collect(),
            ..Measured::default()
        })
        .collect()
}

/// Mean error over the scenes, metres.
fn average_m(measured: &[Measured]) -> Option<f64> {
    mean(&measured.iter().map(ale).collect::<Vec<_>>())
}

/// Standard deviation of the mean error over networks that differ in their seed, metres; `None` for fewer than two.
fn spread_m(by_network: &[Vec<Measured>]) -> Option<f64> {
    let averages: Vec<f64> = by_network.iter().filter_map(|m| average_m(m)).collect();
    let count = averages.len() as f64;
    let middle = averages.iter().sum::<f64>() / count;
    let squares = averages.iter().map(|m| (m - middle).powi(2)).sum::<f64>();
    (averages.len() > 1).then(|| (squares / (count - 1.0)).sqrt())
}

/// Measurements of each network.
fn over_networks(
    trained: &[Trained],
    packs: &Path,
    scenes: &[Scene],
    variant: Variant,
) -> Result<Vec<Vec<Measured>>, TrainingError> {
    trained
        .iter()
        .map(|trained| {
            let mut bench = Bench::new(&trained.model, packs)?;
            Ok(over(&mut bench, scenes, |scene| Ok(variant.setup(scene)?))?)
        })
        .collect()
}

/// How many of the networks had reached their plateau, and how far apart the seeds are.
fn reliability(name: &str, trained: &[Trained], by_network: &[Vec<Measured>]) -> String {
    let at_plateau = trained.iter().filter(|t| t.is_at_plateau() == Some(true));
    let spread = spread_m(by_network).map_or_else(
        || "not known from one seed".to_owned(),
        |metres| format!("{metres:.2} m"),
    );
    format!(
        "{name}: {} of {} trainings had reached their plateau (losses falling by less than 1 % over the last tenth); standard deviation of the average \
         error over the seeds: {spread}.",
        at_plateau.count(),
        trained.len()
    )
}

fn loss_weights(
    networks: &Networks,
    packs: &Path,
    scenes: &[Scene],
) -> Result<ExperimentTable, TrainingError> {
    let mut rows: Vec<Row> = Vec::new();
    let mut notes = Vec::new();
    for (index, name) in WEIGHT_NAMES.iter().enumerate() {
        let mut weights = networks.config().weights;
        if *weight(&mut weights, index) == 0.0 {
            return Err(TrainingError::NoWeight { name });
        }
    }
    for (name, index, factor) in weightings() {
        let trained = networks.get(&name, |config| {
            *weight(&mut config.weights, index) *= factor;
        })?;
        let mut values = Vec::new();
        for variant in VARIANTS {
            let by_network = over_networks(&trained, packs, scenes, variant)?;
            let all = pooled(&by_network);
            let within = Summary::of(&all_frames(&all)).within_20m;
            let called = variant.name(&trained[0].model);
            values.extend([
                (format!("Average ALE, m, {called}"), average_m(&all)),
                (
                    format!("Standard deviation over seeds, m, {called}"),
                    spread_m(&by_network),
                ),
                (format!("Within 20 m, %, {called}"), Some(100.0 * within)),
            ]);
            if variant == Variant::PAPER {
                notes.push(reliability(&name, &trained, &by_network));
            }
        }
        for (i, (row, value)) in values.into_iter().enumerate() {
            if rows.len() <= i {
                rows.push(Row::new(row, Vec::new()));
            }
            rows[i].values.push(value);
        }
    }
    let columns: Vec<Column> = weightings()
        .iter()
        .map(|(name, ..)| Column::new(name.as_str(), "", 2))
        .collect();
    let mut made = table(
        TrainedExperiment::LossWeights.id(),
        "Error under several weights of the losses",
        3,
        scenes,
    );
    made.notes.extend(notes);
    Ok(ExperimentTable {
        columns: columns.clone(),
        rows,
        paper_columns: columns,
        paper: vec![Row::new(
            "Average ALE, m",
            PAPER_LOSS_WEIGHTS_M.map(Some).to_vec(),
        )],
        ..made
    })
}

fn modules(
    networks: &Networks,
    packs: &Path,
    scenes: &[Scene],
) -> Result<ExperimentTable, TrainingError> {
    let retrieval = networks.get("retrieval alone", |config| {
        let weights = &mut config.weights;
        (weights.keypoint, weights.descriptor, weights.homography) = (0.0, 0.0, 0.0);
    })?;
    let matching = networks.get("matching alone", |config| config.weights.global = 0.0)?;
    let joint = networks.get(UNCHANGED, |_| {})?;
    let trained_apart = [retrieval.as_slice(), matching.as_slice()].concat();
    let mut made = table(
        TrainedExperiment::Modules.id(),
        "Retrieval and matching trained apart and together",
        4,
        scenes,
    );
    made.notes.push(
        "G + M: one network was trained for retrieval alone and one for matching alone, with the budget of the joint network each. The matching network \
         searches around each of the five tiles that the other retrieves, up to 1.4 tiles from its centre, chooses there by its own descriptors, and the answer \
         of most inliers wins: it has up to 25 tiles around each, and where a pack's index leaves none of them there is no answer. Its time counts all of \
         these searches."
            .into(),
    );
    for variant in VARIANTS {
        let apart = retrieval
            .iter()
            .zip(&matching)
            .map(|(retrieval, matching)| {
                let finder = Bench::new(&retrieval.model, packs)?;
                let matcher = Bench::new(&matching.model, packs)?;
                scenes
                    .iter()
                    .map(|scene| {
                        let setup = variant.setup(scene).map_err(BenchError::from)?;
                        matcher.measure_apart(&finder, scene, &setup, PAPER_K)
                    })
                    .collect::<Result<Vec<_>, BenchError>>()
            })
            .collect::<Result<Vec<_>, BenchError>>()?;
        let together = over_networks(&joint, packs, scenes, variant)?;
        let called = variant.name(&joint[0].model);
        for (name, trained, by_network) in [
            ("G + M", &trained_apart, apart),
            ("G + M + L", &joint, together),
        ] {
            let name = format!("{name}, {called}");
            made.rows.push(scene_row(&name, &pooled(&by_network)));
            made.notes.push(reliability(&name, trained, &by_network));
        }
    }
    (made.paper_columns, made.paper) = paper_scenes(&PAPER_MODULES);
    Ok(made)
}

fn da_bn(
    networks: &Networks,
    packs: &Path,
    scenes: &[Scene],
) -> Result<ExperimentTable, TrainingError> {
    let mut made = table(
        TrainedExperiment::DaBn.id(),
        "Normalisation by domain, trained",
        10,
        scenes,
    );
    for (name, network, norms) in [
        ("with DA-BN", UNCHANGED, Norms::ByDomain),
        ("without DA-BN", "plain BN", Norms::Joint),
    ] {
        let trained = networks.get(network, |config| config.norms = norms)?;
        for variant in VARIANTS {
            let by_network = over_networks(&trained, packs, scenes, variant)?;
            let name = format!("{name}, {}", variant.name(&trained[0].model));
            made.rows.push(scene_row(&name, &pooled(&by_network)));
            made.notes.push(reliability(&name, &trained, &by_network));
        }
    }
    (made.paper_columns, made.paper) = paper_scenes(&PAPER_DA_BN);
    Ok(made)
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
