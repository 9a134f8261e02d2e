//! How a network localises a procedural flight, in metres: what its losses are for.

use std::path::{Path, PathBuf};

use grimnet_net::Model;

use grimnet_eval::calibration::RIGHT_WITHIN_M;
use grimnet_eval::calibration::scene::{Scene, SceneError, world};
use grimnet_eval::calibration::trial::{TrialError, answer, localizer};

/// A procedural world and photos of it.
#[derive(Debug)]
pub struct Flight {
    scene: Scene,
    pack: PathBuf,
}

/// How a flight was localised, every answer counted, however weak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightFigures {
    /// Whether the heading was known.
    pub heading_known: bool,
    /// Photos.
    pub photos: usize,
    /// Share of them answered within 5 m of the truth.
    pub within_5_m: f64,
    /// The same within 20 m.
    pub within_20_m: f64,
    /// Median error, metres; none where fewer than half of the photos are answered.
    pub median_m: Option<f64>,
}

impl Flight {
    /// Draws the world of a seed, its map into `folder`, and that many photos.
    ///
    /// # Errors
    /// The map cannot be written.
    pub fn draw(seed: u64, photos: usize, folder: &Path) -> Result<Self, SceneError> {
        fs_err::create_dir_all(folder)?;
        Ok(Self {
            scene: world(seed, photos, folder)?,
            pack: folder.join("flight.grim"),
        })
    }

    /// Builds the map's pack with the network and localises every photo, heading known and unknown.
    ///
    /// # Errors
    /// The network cannot run, or the pack cannot be written.
    pub fn measure(&self, model: &Model) -> Result<[FlightFigures; 2], TrialError> {
        let localizer = localizer(model, &self.scene, &self.pack)?;
        let mut errors_m = [Vec::new(), Vec::new()];
        for shot in &self.scene.shots {
            for (heading_known, errors_m) in [true, false].into_iter().zip(&mut errors_m) {
                let found = answer(&localizer, shot, heading_known)?;
                errors_m.push(found.map_or(f64::INFINITY, |answer| answer.error_m()));
            }
        }
        let [known, unknown] = errors_m;
        Ok([
            FlightFigures::of(true, known),
            FlightFigures::of(false, unknown),
        ])
    }
}

impl FlightFigures {
    /// Of the errors of all photos, metres, infinite where there was no answer.
    fn of(heading_known: bool, mut errors_m: Vec<f64>) -> Self {
        errors_m.sort_by(f64::total_cmp);
        let photos = errors_m.len();
        let within = |m: f64| errors_m.partition_point(|&e| e <= m) as f64 / photos.max(1) as f64;
        Self {
            heading_known,
            photos,
            within_5_m: within(5.0),
            within_20_m: within(RIGHT_WITHIN_M),
            median_m: errors_m
                .get(photos.saturating_sub(1) / 2)
                .copied()
                .filter(|m| m.is_finite()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_count_photos_without_an_answer() {
        let none = f64::INFINITY;
        let figures = FlightFigures::of(true, vec![30.0, 4.0, none, 1.0, 12.0, none, 2.0, none]);
        assert_eq!((figures.within_5_m, figures.within_20_m), (0.375, 0.5));
        assert_eq!(figures.median_m, Some(12.0), "the fourth of eight");
        assert_eq!(
            FlightFigures::of(false, vec![none, none, 1.0]).median_m,
            None
        );
        assert_eq!(FlightFigures::of(false, Vec::new()).within_5_m, 0.0);
    }

    #[test]
    fn the_bundled_network_localises_a_flight() {
        let folder = tempfile::tempdir().unwrap();
        let flight = Flight::draw(1003, 3, folder.path()).unwrap();
        let model = Model::bundled().unwrap();
        for _ in 0..2 {
            let [known, unknown] = flight.measure(&model).unwrap();
            assert!(known.heading_known && !unknown.heading_known);
            assert_eq!(known.photos, 3);
            assert!(known.within_20_m > 0.6, "{known:?}");
        }
    }
}
