//! The paper's tables 8 and 9 and figure 7: methods compared, frame by frame.

use grimnet_eval::metrics::{Frame, Summary};
use grimnet_eval::report::plot::{error_per_frame, runs_compared};
use grimnet_eval::scene::Scene;

use crate::bench::{Bench, BenchError, Localisation, Setup};
use crate::experiment::Experiment;
use crate::experiment_table::{Column, ExperimentTable, Figure, Row};
use crate::recipe::Variant;
use crate::scene_rows::{PAPER_SCENES, all_frames, over, paper_scenes, scene_row, table};

/// What the rows are given.
const NOTE: &str = "Within each third of the rows the inputs are equal: nothing but the photo and the map's own pixels, the heading as well, or heading and \
    ground width. SIFT searches every tile of the level that default mode compares a photo with first, and answers with the one of most inliers; without a \
    ground width it takes the photo to be as wide as a tile, and finds its scale itself. Default mode without a ground width tries several, those near 165 m \
    first. The paper's procedure always answers; without heading and scale its tiles are 512 map pixels wide, whatever a photo shows. GLVL has not been run: \
    its authors' weights are not part of this program.";

pub(super) fn methods(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
) -> Result<ExperimentTable, BenchError> {
    let (mut rows, mut runs) = (Vec::new(), Vec::new());
    for pair in Variant::PAIRS {
        let sift = over(bench, scenes, |scene| {
            Ok(Setup {
                method: Localisation::SiftWholeMap,
                ..pair[1].setup(scene)?
            })
        })?;
        let given = pair[1].name(bench.model());
        let given = given.split_once("; ").map_or("", |(_, given)| given);
        let mut measured = vec![(format!("SIFT; {given}"), sift)];
        for variant in pair {
            let name = variant.name(bench.model());
            measured.push((
                name,
                over(bench, scenes, |scene| Ok(variant.setup(scene)?))?,
            ));
        }
        for (name, measured) in measured {
            rows.push(scene_row(&name, &measured));
            runs.push((name, all_frames(&measured)));
        }
    }
    let (paper_columns, paper) = paper_scenes(&[
        ("SIFT", [70.89, 67.77, 42.68, 50.01, 89.51]),
        ("GLVL", [5.35, 13.65, 17.83, 30.47, 15.32]),
        ("GRiM-Net", [4.33, 11.84, 13.96, 29.62, 13.85]),
    ]);
    let drawn: Vec<(&str, &[Frame])> = runs.iter().map(|(n, f)| (n.as_str(), &f[..])).collect();
    let mut made = table(Experiment::Methods.id(), "Methods compared", 8, scenes);
    made.notes.push(NOTE.to_owned());
    made.figures.push(Figure {
        file: "methods-errors.svg".to_owned(),
        title: "Error of every frame by every method (figure 7b of the paper)".to_owned(),
        svg: runs_compared(&drawn)?,
    });
    Ok(ExperimentTable {
        rows,
        paper_columns,
        paper,
        ..made
    })
}

pub(super) fn success(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
) -> Result<ExperimentTable, BenchError> {
    let rate = |frames: &[Frame]| Some(100.0 * Summary::of(frames).within_20m);
    let (mut rows, mut figures) = (Vec::new(), Vec::new());
    for variant in Variant::PAIRS.concat() {
        let measured = over(bench, scenes, |scene| Ok(variant.setup(scene)?))?;
        let mut values: Vec<Option<f64>> = measured.iter().map(|m| rate(&m.frames)).collect();
        let frames = all_frames(&measured);
        values.push(rate(&frames));
        let name = variant.name(bench.model());
        figures.push(Figure {
            file: format!("success-errors-{}.svg", figures.len() + 1),
            title: format!("Error of every frame, {name} (figure 7a of the paper)"),
            svg: error_per_frame(&frames)?,
        });
        rows.push(Row::new(name, values));
    }
    let mut columns: Vec<Column> = scenes.iter().map(|s| Column::percent(&*s.name)).collect();
    columns.push(Column::percent("all frames"));
    let mut paper_columns = PAPER_SCENES.map(Column::percent).to_vec();
    paper_columns.push(Column::percent("all frames"));
    Ok(ExperimentTable {
        columns,
        rows,
        paper_columns,
        paper: vec![Row::new(
            "Error below 20 m",
            [96.6, 91.5, 83.8, 84.5, 91.7, 89.3].map(Some).to_vec(),
        )],
        notes: vec!["A frame without a fix counts as a failure.".to_owned()],
        figures,
        ..table(
            Experiment::Success.id(),
            "Share of all frames with an error below 20 m",
            9,
            scenes,
        )
    })
}
