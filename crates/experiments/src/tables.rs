//! The paper's tables 2 and 4 to 10 by name: which setups they compare, and the paper's own figures.

use grimnet_locate::Options;
use grimnet_net::Domain;
use grimnet_pack::BuildOptions;

use crate::bench::{Bench, BenchError, Localisation, Measured, Setup, at_gsd};
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::photometry::Photometry;
use crate::scene_rows::{
    ALE_NOTE, PAPER_DA_BN, PAPER_MODULES, PAPER_SCENES, ale, all_frames, mean, mean_time_s, over,
    paper_scenes, scene_row, table,
};
use grimnet_eval::metrics::rank_distance::{FrameDistances, RankDistance};
use grimnet_eval::metrics::recall::Recall;
use grimnet_eval::metrics::{Frame, Summary};
use grimnet_eval::scene::Scene;

/// The experiments that need no training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Experiment {
    /// Table 2: processing resolution.
    Resolution,
    /// Table 4: combinations of modules.
    Modules,
    /// Table 5: recall for K candidates.
    TopKRecall,
    /// Table 6: error and time for K candidates.
    TopK,
    /// Table 7: changes of light.
    Photometry,
    /// Table 8: methods compared.
    Methods,
    /// Table 9: success.
    Success,
    /// Table 10: domain-adaptive normalisation.
    DaBn,
}

/// The two methods.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Recipe {
    /// The default method.
    #[default]
    Default,
    /// The publication without changes.
    Paper,
}

impl Recipe {
    /// A setup of this method with known headings.
    #[must_use]
    pub fn setup(self) -> Setup {
        let (build, options) = match self {
            Self::Default => (BuildOptions::standard(), Options::default()),
            Self::Paper => (BuildOptions::paper(), Options::paper()),
        };
        Setup {
            build,
            options,
            heading_known: true,
            ..Setup::default()
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Default => "GRiM-Net, default mode",
            Self::Paper => "GRiM-Net, paper mode",
        }
    }
}

/// Sides of the network's input (table 2), pixels.
const RESOLUTIONS: [u32; 5] = [160, 256, 320, 384, 512];

/// The paper's default resolution; it corresponds to the default width of a query in default mode.
const PAPER_RESOLUTION: f64 = 320.0;

/// K of table 5.
const RECALL_K: [usize; 6] = [1, 2, 3, 5, 8, 10];

/// K of table 6.
const ERROR_K: [usize; 4] = [1, 3, 5, 10];

/// K at which G + S retrieves, as in the paper.
pub(super) const PAPER_K: usize = 5;

/// Runs an experiment.
///
/// # Errors
/// A pack cannot be built, or a photo has no known scale but needs one.
pub fn run(
    experiment: Experiment,
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    match experiment {
        Experiment::Resolution => resolution(bench, scenes, recipe),
        Experiment::Modules => modules(bench, scenes, recipe),
        Experiment::TopKRecall => top_k_recall(bench, scenes, recipe),
        Experiment::TopK => top_k(bench, scenes, recipe),
        Experiment::Photometry => photometry(bench, scenes, recipe),
        Experiment::Methods => methods(bench, scenes),
        Experiment::Success => success(bench, scenes, recipe),
        Experiment::DaBn => da_bn(bench, scenes, recipe),
    }
}

fn resolution(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    let mut rows = [
        ("Average ALE", Vec::new()),
        ("Within 20 m", Vec::new()),
        ("Time a frame", Vec::new()),
    ];
    for side in RESOLUTIONS {
        let mut measured = Vec::new();
        for scene in scenes {
            let mut setup = recipe.setup();
            match (recipe, scene.ground_width_m()?) {
                (Recipe::Default, Some(width_m)) => {
                    // As many pixels across the photo, more or fewer, as the default sees at the paper's default.
                    let across_px =
                        setup.options.query_width_px * f64::from(side) / PAPER_RESOLUTION;
                    setup.build = at_gsd(setup.build, width_m / across_px);
                }
                _ => setup.build.resolution = side,
            }
            measured.push(bench.measure(scene, &setup)?);
        }
        let frames = all_frames(&measured);
        rows[0]
            .1
            .push(mean(&measured.iter().map(ale).collect::<Vec<_>>()));
        rows[1]
            .1
            .push(Some(100.0 * Summary::of(&frames).within_20m));
        rows[2].1.push(mean_time_s(&frames));
    }
    let head = |side: u32| Column::new(format!("{side} x {side}"), "", 2);
    let mut notes = vec![
        "ALE in metres, share of all frames in percent, time in seconds.".to_owned(),
        ALE_NOTE.to_owned(),
    ];
    if recipe == Recipe::Default {
        notes.push("Default mode keeps the photo's shape: here the ground resolution of the level varies, so that a photo is 1.4 times the stated side across.".to_owned());
    }
    Ok(ExperimentTable {
        columns: RESOLUTIONS.map(head).to_vec(),
        rows: rows.map(|(name, values)| Row::new(name, values)).to_vec(),
        paper_columns: RESOLUTIONS.map(head).to_vec(),
        paper: vec![Row::new(
            "Average ALE",
            [21.53, 16.48, 14.72, 14.61, 14.07].map(Some).to_vec(),
        )],
        notes,
        ..table(
            "resolution",
            "Error at several processing resolutions",
            2,
            scenes,
        )
    })
}

/// A setup that matches every tile of the level, without retrieval (M + L).
fn block_by_block(setup: Setup) -> Setup {
    Setup {
        options: Options {
            top_k: usize::MAX,
            max_matched: usize::MAX,
            min_matched: usize::MAX,
            clear_inliers: usize::MAX,
            vote: None,
            ..setup.options
        },
        ..setup
    }
}

fn sift_among_retrieved(setup: Setup) -> Setup {
    Setup {
        method: Localisation::SiftAmongRetrieved,
        options: Options {
            top_k: PAPER_K,
            ..setup.options
        },
        ..setup
    }
}

fn modules(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    let full = recipe.setup();
    let rows = [
        ("G + S", sift_among_retrieved(full.clone())),
        ("M + L", block_by_block(full.clone())),
        ("G + M + L", full),
    ];
    let rows = rows
        .iter()
        .map(|(name, setup)| Ok(scene_row(name, &over(bench, scenes, setup)?)))
        .collect::<Result<_, BenchError>>()?;
    let (paper_columns, paper) = paper_scenes(&PAPER_MODULES);
    let mut made = table("modules", "Combinations of modules", 4, scenes);
    made.notes.push(
        "G: retrieval of tiles; M: learned matching; L: one network trained for both; S: SIFT for matching, always answering with the tile of most inliers. \
         M + L matches every tile. The map's features are made beforehand in all rows, SIFT's too."
            .to_owned(),
    );
    Ok(ExperimentTable {
        rows,
        paper_columns,
        paper,
        ..made
    })
}

fn top_k_recall(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    let mut setup = recipe.setup();
    setup.options.top_k = setup.options.top_k.max(RECALL_K[RECALL_K.len() - 1]);
    let measured = over(bench, scenes, &setup)?;
    let join = |ranks: fn(&Measured) -> &Vec<grimnet_eval::metrics::recall::FrameRecall>| {
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
    let row = |name: &str, shares: &[f64]| {
        Row::new(name, shares.iter().map(|s| Some(100.0 * s)).collect())
    };
    let columns: Vec<Column> = RECALL_K
        .map(|k| Column::percent(format!("K = {k}")))
        .to_vec();
    Ok(ExperimentTable {
        columns: columns.clone(),
        rows: vec![
            row("by descriptor, centre within 64 px of the truth", &near.by_descriptor),
            row("by descriptor, tile covers the truth", &covers.by_descriptor),
            row("after the vote, tile covers the truth", &covers.by_vote),
            row("by descriptor, SDM@K", &by_distance.sdm_by_descriptor),
            row("after the vote, SDM@K", &by_distance.sdm_by_vote),
            row("by descriptor, PDM@K", &by_distance.pdm_by_descriptor),
            row("after the vote, PDM@K", &by_distance.pdm_by_vote),
        ],
        paper_columns: columns,
        paper: vec![Row::new("Recall@K, centre within 64 px", [82.3, 86.9, 89.7, 92.2, 92.8, 93.1].map(Some).to_vec())],
        notes: vec![
            "SDM@K (Dai et al. 2024) and PDM@K (Ye et al. 2026) score each of the first K tiles by its distance from the truth, the earlier ranks more.".to_owned(),
            "At a stride of 256 px only a fifth of all places has any tile centre within 64 px: the paper's figures cannot be had with its own tiling.".to_owned(),
        ],
        ..table("top-k-recall", "Recall for K candidates", 5, scenes)
    })
}

fn top_k(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    let mut rows = Vec::new();
    for k in ERROR_K {
        let mut setup = recipe.setup();
        setup.options.top_k = k;
        setup.options.max_matched = k;
        setup.options.min_matched = k;
        rows.push(scene_row(
            &format!("K = {k}"),
            &over(bench, scenes, &setup)?,
        ));
    }
    let (paper_columns, paper) = paper_scenes(&[
        ("K = 1", [9.21, 18.43, 22.14, 41.31, 19.86]),
        ("K = 3", [5.88, 13.22, 15.47, 31.79, 15.15]),
        ("K = 5", [4.33, 11.84, 13.96, 29.62, 13.85]),
        ("K = 10", [4.21, 11.71, 13.74, 29.41, 13.81]),
    ]);
    Ok(ExperimentTable {
        rows,
        paper_columns,
        paper,
        ..table(
            "top-k",
            "Error and time for K candidates by descriptor",
            6,
            scenes,
        )
    })
}

fn photometry(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    let conditions = [
        ("Original condition", Photometry::Original),
        ("Low brightness (x 0.5)", Photometry::Brightness(0.5)),
        ("High brightness (x 1.5)", Photometry::Brightness(1.5)),
        ("Low contrast (x 0.6)", Photometry::Contrast(0.6)),
    ];
    let mut rows = Vec::new();
    for (name, photometry) in conditions {
        let setup = Setup {
            photometry,
            ..recipe.setup()
        };
        rows.push(scene_row(name, &over(bench, scenes, &setup)?));
    }
    let (paper_columns, paper) = paper_scenes(&[
        ("Original condition", [4.33, 11.84, 13.96, 29.62, 13.85]),
        ("Low brightness (x 0.5)", [5.25, 13.87, 16.82, 34.01, 16.18]),
        (
            "High brightness (x 1.5)",
            [4.86, 12.98, 15.37, 32.45, 14.83],
        ),
        ("Low contrast (x 0.6)", [4.71, 12.62, 14.84, 30.80, 14.42]),
    ]);
    Ok(ExperimentTable {
        rows,
        paper_columns,
        paper,
        ..table("photometry", "Error under changes of light", 7, scenes)
    })
}

fn methods(bench: &mut Bench<'_>, scenes: &[Scene]) -> Result<ExperimentTable, BenchError> {
    let sift = Setup {
        method: Localisation::SiftWholeMap,
        ..Recipe::Default.setup()
    };
    let rows = vec![
        scene_row("SIFT", &over(bench, scenes, &sift)?),
        scene_row(
            Recipe::Paper.name(),
            &over(bench, scenes, &Recipe::Paper.setup())?,
        ),
        scene_row(
            Recipe::Default.name(),
            &over(bench, scenes, &Recipe::Default.setup())?,
        ),
    ];
    let (paper_columns, paper) = paper_scenes(&[
        ("SIFT", [70.89, 67.77, 42.68, 50.01, 89.51]),
        ("GLVL", [5.35, 13.65, 17.83, 30.47, 15.32]),
        ("GRiM-Net", [4.33, 11.84, 13.96, 29.62, 13.85]),
    ]);
    let mut made = table("methods", "Methods compared", 8, scenes);
    made.notes.push(
        "SIFT searches every tile and answers with the one of most inliers. Paper mode uses neither heading nor scale and always answers. GLVL has not been \
         run: its authors' weights are not part of this program."
            .to_owned(),
    );
    Ok(ExperimentTable {
        rows,
        paper_columns,
        paper,
        ..made
    })
}

fn success(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    let measured = over(bench, scenes, &recipe.setup())?;
    let rate = |frames: &[Frame]| Some(100.0 * Summary::of(frames).within_20m);
    let mut values: Vec<Option<f64>> = measured.iter().map(|m| rate(&m.frames)).collect();
    values.push(rate(&all_frames(&measured)));
    let mut columns: Vec<Column> = scenes.iter().map(|s| Column::percent(&*s.name)).collect();
    columns.push(Column::percent("all frames"));
    let mut paper_columns = PAPER_SCENES.map(Column::percent).to_vec();
    paper_columns.push(Column::percent("all frames"));
    Ok(ExperimentTable {
        columns,
        rows: vec![Row::new("Error below 20 m", values)],
        paper_columns,
        paper: vec![Row::new(
            "Error below 20 m",
            [96.6, 91.5, 83.8, 84.5, 91.7, 89.3].map(Some).to_vec(),
        )],
        notes: vec!["A frame without a fix is no success.".to_owned()],
        ..table(
            "success",
            "Share of all frames with an error below 20 m",
            9,
            scenes,
        )
    })
}

fn da_bn(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    recipe: Recipe,
) -> Result<ExperimentTable, BenchError> {
    let one = Setup {
        photos_as: Some(Domain::Sat),
        ..recipe.setup()
    };
    let rows = vec![
        scene_row(
            "Normalisation of each domain",
            &over(bench, scenes, &recipe.setup())?,
        ),
        scene_row("The map's for photos, too", &over(bench, scenes, &one)?),
    ];
    let (paper_columns, paper) = paper_scenes(&PAPER_DA_BN);
    let mut made = table("da-bn", "Normalisation by domain", 10, scenes);
    made.notes.push(
        "The second row runs photos through the statistics and parameters of the map's domain, with the same trained weights; the paper trained a second \
         network with plain batch normalisation."
            .to_owned(),
    );
    Ok(ExperimentTable {
        rows,
        paper_columns,
        paper,
        ..made
    })
}
