//! One photo that was localised with the gates nearly open, and its error.

use std::path::Path;

use grimnet_locate::Support;
use serde::{Deserialize, Serialize};

use crate::metrics::footprint::RIGHT_WITHIN_M;

/// One photo and its answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Scene of the photo; scenes are held out as a whole.
    pub scene: usize,
    /// Whether it was localised on another scene's map.
    pub elsewhere: bool,
    /// Whether the localiser was given the heading.
    pub heading_known: bool,
    /// Whether photo and map are real pictures of different origin. Their truth is registered and not exact, so the covariance is
    /// not fitted to them; how often photos taken elsewhere get a fix is.
    pub real: bool,
    /// The answer, if there is one.
    pub answer: Option<Answer>,
}

/// An answer, right or wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Error to the east, metres; without meaning on another scene's map.
    pub error_east_m: f64,
    /// Error to the north, metres; likewise.
    pub error_north_m: f64,
    /// Ground resolution of the level, metres per pixel.
    pub level_gsd_m: f64,
    /// Its support by matches.
    pub support: Support,
}

impl Answer {
    /// Distance from the truth, metres.
    #[must_use]
    pub fn error_m(&self) -> f64 {
        self.error_east_m.hypot(self.error_north_m)
    }
}

impl Observation {
    /// Returns whether the answer is the right place.
    #[must_use]
    pub fn is_right(&self) -> bool {
        !self.elsewhere
            && self
                .answer
                .is_some_and(|answer| answer.error_m() <= RIGHT_WITHIN_M)
    }
}

/// One line of a file of observations.
#[derive(Serialize, Deserialize)]
struct Row {
    scene: usize,
    elsewhere: bool,
    heading_known: bool,
    real: bool,
    error_east_m: Option<f64>,
    error_north_m: Option<f64>,
    level_gsd_m: Option<f64>,
    inliers: Option<usize>,
    places: Option<usize>,
    matches: Option<usize>,
    runner_up_inliers: Option<usize>,
    spread: Option<f64>,
    inlier_ee_m2: Option<f64>,
    inlier_en_m2: Option<f64>,
    inlier_nn_m2: Option<f64>,
    expected_inliers: Option<f64>,
    held_back_points: Option<usize>,
    held_back_excess: Option<f64>,
    on_map: Option<f64>,
}

/// Writes observations as CSV; [`read`] gives them back.
///
/// # Errors
/// The file cannot be written.
pub fn write(to: impl std::io::Write, observations: &[Observation]) -> csv::Result<()> {
    write_rows(to, true, observations)
}

fn write_rows(
    to: impl std::io::Write,
    has_header: bool,
    observations: &[Observation],
) -> csv::Result<()> {
    let mut writer = csv::WriterBuilder::new()
        .has_headers(has_header)
        .from_writer(to);
    for observation in observations {
        writer.serialize(Row::of(observation))?;
    }
    writer.flush()?;
    Ok(())
}

/// An observation as a line of CSV without a header; [`of_line`] gives it back.
///
/// # Errors
/// Never: the line is made in memory.
pub fn line(observation: &Observation) -> csv::Result<Vec<u8>> {
    let mut line = Vec::new();
    write_rows(&mut line, false, std::slice::from_ref(observation))?;
    Ok(line)
}

/// Reads what [`line()`] made; `None` for anything else.
#[must_use]
pub fn of_line(line: &[u8]) -> Option<Observation> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .from_reader(line);
    let row = reader.deserialize::<Row>().next()?.ok()?;
    Some(row.observation())
}

/// Reads observations that [`write()`] wrote.
///
/// # Errors
/// The file cannot be read or has other columns.
pub fn read(path: &Path) -> csv::Result<Vec<Observation>> {
    csv::Reader::from_path(path)?
        .deserialize()
        .map(|row| row.map(Row::observation))
        .collect()
}

impl Row {
    fn of(o: &Observation) -> Self {
        let answer = o.answer.as_ref();
        let support = answer.map(|a| a.support);
        let covariance = support.map(|s| s.inlier_covariance_en_m2);
        Self {
            scene: o.scene,
            elsewhere: o.elsewhere,
            heading_known: o.heading_known,
            real: o.real,
            error_east_m: answer.map(|a| a.error_east_m),
            error_north_m: answer.map(|a| a.error_north_m),
            level_gsd_m: answer.map(|a| a.level_gsd_m),
            inliers: support.map(|s| s.inliers),
            places: support.map(|s| s.places),
            matches: support.map(|s| s.matches),
            runner_up_inliers: support.map(|s| s.runner_up_inliers),
            spread: support.map(|s| s.spread),
            inlier_ee_m2: covariance.map(|c| c[0]),
            inlier_en_m2: covariance.map(|c| c[1]),
            inlier_nn_m2: covariance.map(|c| c[2]),
            expected_inliers: support.map(|s| s.expected_inliers),
            held_back_points: support.map(|s| s.held_back_points),
            held_back_excess: support.map(|s| s.held_back_excess),
            on_map: support.map(|s| s.on_map),
        }
    }

    fn observation(self) -> Observation {
        let answer = || {
            Some(Answer {
                error_east_m: self.error_east_m?,
                error_north_m: self.error_north_m?,
                level_gsd_m: self.level_gsd_m?,
                support: Support {
                    inliers: self.inliers?,
                    places: self.places?,
                    matches: self.matches?,
                    runner_up_inliers: self.runner_up_inliers?,
                    spread: self.spread?,
                    expected_inliers: self.expected_inliers?,
                    held_back_points: self.held_back_points?,
                    held_back_excess: self.held_back_excess?,
                    on_map: self.on_map?,
                    inlier_covariance_en_m2: [
                        self.inlier_ee_m2?,
                        self.inlier_en_m2?,
                        self.inlier_nn_m2?,
                    ],
                },
            })
        };
        Observation {
            scene: self.scene,
            elsewhere: self.elsewhere,
            heading_known: self.heading_known,
            real: self.real,
            answer: answer(),
        }
    }
}
