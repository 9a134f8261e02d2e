//! The paper's tables 2 and 4 to 10 by name: which setups they compare, and the paper's own figures.

mod methods;
mod recall;

use grimnet_eval::metrics::Summary;
use grimnet_eval::scene::Scene;
use grimnet_locate::Options;
use grimnet_net::Domain;
use grimnet_pack::Index;

use crate::bench::{Bench, BenchError, Localisation, Setup, at_gsd};
use crate::experiment::Experiment;
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::photometry::Photometry;
use crate::recipe::{Recipe, Variant};
use crate::scene_rows::{
    ALE_NOTE, INPUTS_NOTE, PAPER_DA_BN, PAPER_MODULES, PaperRow, ale, all_frames, mean,
    mean_time_s, over, paper_scenes, scene_row, table,
};

/// Sides of the network's input (table 2), pixels.
const RESOLUTIONS: [u32; 5] = [160, 256, 320, 384, 512];

/// The paper's default resolution; it corresponds to the default width of a query in default mode.
const PAPER_RESOLUTION: f64 = 320.0;

/// The rows of table 2: the resolution of default mode follows from the ground width, which must then be given.
const RESIZED: [Variant; 3] = [
    Variant::PAPER,
    Variant::PAPER_WITH_PRIOR,
    Variant::DEFAULT_WITH_PRIOR,
];

/// K of table 6.
const ERROR_K: [usize; 4] = [1, 3, 5, 10];

/// What K is in default mode, which searches several headings and ground widths ([`Options::top_k`]).
const K_NOTE: &str = "In default mode K counts for each heading and ground width that is tried: one of each with heading and scale given; with \
    nothing given twelve headings and, for each level of the map, two ground widths, so that up to 24 times K tiles of a level are candidates.";

/// K at which G + S retrieves, as in the paper.
pub(super) const PAPER_K: usize = 5;

/// Runs an experiment.
///
/// # Errors
/// A pack cannot be built, or a photo cannot be read.
pub fn run(
    experiment: Experiment,
    bench: &mut Bench<'_>,
    scenes: &[Scene],
) -> Result<ExperimentTable, BenchError> {
    match experiment {
        Experiment::Resolution => resolution(bench, scenes),
        Experiment::Modules => modules(bench, scenes),
        Experiment::TopKRecall => recall::top_k_recall(bench, scenes),
        Experiment::TopK => top_k(bench, scenes),
        Experiment::Photometry => photometry(bench, scenes),
        Experiment::Methods => methods::methods(bench, scenes),
        Experiment::Success => methods::success(bench, scenes),
        Experiment::DaBn => da_bn(bench, scenes),
    }
}

fn resolution(bench: &mut Bench<'_>, scenes: &[Scene]) -> Result<ExperimentTable, BenchError> {
    let mut rows = Vec::new();
    for variant in RESIZED {
        let mut values = [Vec::new(), Vec::new(), Vec::new()];
        for side in RESOLUTIONS {
            let measured = scenes
                .iter()
                .map(|scene| bench.measure(scene, &at_resolution(variant, scene, side)?))
                .collect::<Result<Vec<_>, BenchError>>()?;
            let frames = all_frames(&measured);
            values[0].push(mean(&measured.iter().map(ale).collect::<Vec<_>>()));
            values[1].push(Some(100.0 * Summary::of(&frames).within_20m));
            values[2].push(mean_time_s(&frames));
        }
        let name = variant.name(bench.model());
        let kinds = ["Average ALE", "Within 20 m", "Time per frame"];
        for (kind, values) in kinds.into_iter().zip(values) {
            rows.push(Row::new(format!("{kind}, {name}"), values));
        }
    }
    let head = |side: u32| Column::new(format!("{side} x {side}"), "", 2);
    Ok(ExperimentTable {
        columns: RESOLUTIONS.map(head).to_vec(),
        rows,
        paper_columns: RESOLUTIONS.map(head).to_vec(),
        paper: vec![Row::new(
            "Average ALE",
            [21.53, 16.48, 14.72, 14.61, 14.07].map(Some).to_vec(),
        )],
        notes: vec![
            "ALE in metres, share of all frames in percent, time in seconds.".to_owned(),
            ALE_NOTE.to_owned(),
            "The rows of the paper's procedure without other words are given nothing but the pixels, as published; all other rows are given heading and ground width. Default mode with nothing given is missing: its resolution follows from the ground width.".to_owned(),
            "Default mode keeps the photo's shape: there the ground resolution of the level varies, so that a photo is 1.4 times the stated side across.".to_owned(),
        ],
        ..table(
            Experiment::Resolution.id(),
            "Error at several processing resolutions",
            2,
            scenes,
        )
    })
}

/// The setup at a processing resolution of `side` pixels.
fn at_resolution(variant: Variant, scene: &Scene, side: u32) -> Result<Setup, BenchError> {
    let mut setup = variant.setup(scene)?;
    match (variant.recipe, scene.ground_width_m()?) {
        (Recipe::Default, Some(width_m)) => {
            // As many pixels across the photo, more or fewer, as the default sees at the paper's default.
            let across_px = setup.options.query_width_px * f64::from(side) / PAPER_RESOLUTION;
            setup.build = at_gsd(setup.build, width_m / across_px);
        }
        _ => setup.build.resolution = side,
    }
    Ok(setup)
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
            // The paper's index would look into a part of its lists only.
            index: Some(Index::Exact),
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

/// Rows of a table: each case with each method, on all scenes.
fn varied<T: Copy>(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    cases: &[(&str, T)],
    change: impl Fn(Setup, T) -> Setup,
) -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    for variant in Variant::SWEPT {
        for &(name, case) in cases {
            rows.push(row_of(bench, scenes, (name, variant), |setup| {
                change(setup, case)
            })?);
        }
    }
    Ok(rows)
}

/// The row of a variant whose setup is changed.
fn row_of(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    (name, variant): (&str, Variant),
    change: impl Fn(Setup) -> Setup,
) -> Result<Row, BenchError> {
    let measured = over(bench, scenes, |scene| Ok(change(variant.setup(scene)?)))?;
    let name = format!("{name}, {}", variant.name(bench.model()));
    Ok(scene_row(&name, &measured))
}

/// The table with its rows and the paper's, whose inputs are explained last.
fn filled(mut table: ExperimentTable, rows: Vec<Row>, paper: &[PaperRow]) -> ExperimentTable {
    table.notes.push(INPUTS_NOTE.to_owned());
    (table.paper_columns, table.paper) = paper_scenes(paper);
    ExperimentTable { rows, ..table }
}

/// Matching of every tile, without retrieval.
const BLOCK_BY_BLOCK: &str = "M + L";

/// What a combination of modules changes of a setup.
type Change = fn(Setup) -> Setup;

fn modules(bench: &mut Bench<'_>, scenes: &[Scene]) -> Result<ExperimentTable, BenchError> {
    let changes: [(&str, Change); 3] = [
        ("G + S", sift_among_retrieved),
        (BLOCK_BY_BLOCK, block_by_block),
        ("G + M + L", |setup| setup),
    ];
    let mut rows = Vec::new();
    for variant in Variant::SWEPT {
        for (name, change) in changes {
            // Every tile at every heading and scale takes many seconds a photo.
            if name == BLOCK_BY_BLOCK && variant == Variant::DEFAULT_WITHOUT_PRIOR {
                continue;
            }
            rows.push(row_of(bench, scenes, (name, variant), change)?);
        }
    }
    let mut made = table(
        Experiment::Modules.id(),
        "Combinations of modules",
        4,
        scenes,
    );
    made.notes.push(
        "G: retrieval of tiles; M: learned matching; L: one network trained for both; S: SIFT for matching; by the paper's procedure with the paper's geometry, choice of the tile and answer where none has a homography (S has coordinates of the georeference in place of eq. 22 and 23), by default mode with a similarity and the tile of most inliers. \
         M + L matches every tile; of default mode with nothing given, which would match every tile at every heading and scale, it was not run. The map's features are made beforehand in all rows, SIFT's too."
            .to_owned(),
    );
    Ok(filled(made, rows, &PAPER_MODULES))
}

fn top_k(bench: &mut Bench<'_>, scenes: &[Scene]) -> Result<ExperimentTable, BenchError> {
    let paper = [
        ("K = 1", [9.21, 18.43, 22.14, 41.31, 19.86]),
        ("K = 3", [5.88, 13.22, 15.47, 31.79, 15.15]),
        ("K = 5", [4.33, 11.84, 13.96, 29.62, 13.85]),
        ("K = 10", [4.21, 11.71, 13.74, 29.41, 13.81]),
    ];
    let cases: Vec<(&str, usize)> = paper.iter().map(|row| row.0).zip(ERROR_K).collect();
    let rows = varied(bench, scenes, &cases, |mut setup, k| {
        setup.options.top_k = k;
        setup.options.max_matched = k;
        setup.options.first_matched = k;
        setup.options.min_matched = k;
        setup
    })?;
    let mut made = table(
        Experiment::TopK.id(),
        "Error and time for K candidates by descriptor",
        6,
        scenes,
    );
    made.notes.push(K_NOTE.to_owned());
    Ok(filled(made, rows, &paper))
}

fn photometry(bench: &mut Bench<'_>, scenes: &[Scene]) -> Result<ExperimentTable, BenchError> {
    let paper = [
        ("Original condition", [4.33, 11.84, 13.96, 29.62, 13.85]),
        ("Low brightness (x 0.5)", [5.25, 13.87, 16.82, 34.01, 16.18]),
        (
            "High brightness (x 1.5)",
            [4.86, 12.98, 15.37, 32.45, 14.83],
        ),
        ("Low contrast (x 0.6)", [4.71, 12.62, 14.84, 30.80, 14.42]),
    ];
    let conditions = [
        Photometry::Original,
        Photometry::Brightness(0.5),
        Photometry::Brightness(1.5),
        Photometry::Contrast(0.6),
    ];
    let cases: Vec<(&str, Photometry)> = paper.iter().map(|row| row.0).zip(conditions).collect();
    let rows = varied(bench, scenes, &cases, |setup, photometry| Setup {
        photometry,
        ..setup
    })?;
    let made = table(
        Experiment::Photometry.id(),
        "Error under photometric changes",
        7,
        scenes,
    );
    Ok(filled(made, rows, &paper))
}

fn da_bn(bench: &mut Bench<'_>, scenes: &[Scene]) -> Result<ExperimentTable, BenchError> {
    let cases = [
        ("Statistics of each domain", None),
        ("The map's statistics for photos, too", Some(Domain::Sat)),
    ];
    let rows = varied(bench, scenes, &cases, |setup, photos_as| Setup {
        photos_as,
        ..setup
    })?;
    let mut made = table(Experiment::DaBn.id(), "Normalisation by domain", 10, scenes);
    made.notes.push(
        "The second row of each pair runs photos through the statistics and parameters of the map's domain, with the same trained weights; the paper \
         trained a second network with plain batch normalisation."
            .to_owned(),
    );
    Ok(filled(made, rows, &PAPER_DA_BN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_retrieval_no_index_leaves_tiles_out() {
        for variant in Variant::SWEPT {
            let options = block_by_block(variant.plain_setup()).options;
            assert_eq!(options.index, Some(Index::Exact));
            assert_eq!(
                (options.top_k, options.max_matched),
                (usize::MAX, usize::MAX)
            );
        }
    }
}
