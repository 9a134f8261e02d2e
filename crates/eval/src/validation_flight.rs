//! How a network localises a procedural flight, in metres: the measure of a training run.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use grimnet_net::Model;

use crate::calibration::observer::ObserveError;
use crate::calibration::scenes::{SceneError, world};
use crate::calibration::trial::{answer, localizer};
use crate::metrics::footprint::RIGHT_WITHIN_M;
use crate::scene::{HeadingMode, Scene};

/// A procedural world and photos of it.
pub struct ValidationFlight {
    scene: Scene,
    pack: PathBuf,
}

/// Why a flight cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DrawError {
    /// The scene cannot be made.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The folder cannot be created.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// How a flight was localised, every answer counted, however weak its support.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightFigures {
    /// Whether the heading was known.
    pub heading_known: bool,
    /// Photos.
    pub photos: usize,
    /// Share of photos within 5 m of the truth.
    pub within_5_m: f64,
    /// The same within 20 m.
    pub within_20_m: f64,
    /// Median error, metres; `None` if fewer than half of the photos have an answer.
    pub median_m: Option<f64>,
}

impl ValidationFlight {
    /// Draws the world of a seed, its map into `folder`, and that many photos.
    ///
    /// # Errors
    /// The map cannot be written.
    pub fn draw(seed: u64, photos: usize, folder: &Path) -> Result<Self, DrawError> {
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
    pub fn measure(&self, model: &Model) -> Result<[FlightFigures; 2], ObserveError> {
        let localizer = localizer(model, &self.scene, &self.pack, &AtomicBool::new(false))?;
        let mut errors_m = [Vec::new(), Vec::new()];
        let modes = [HeadingMode::Known, HeadingMode::Unknown];
        for shot in &self.scene.shots {
            for (heading, errors_m) in modes.into_iter().zip(&mut errors_m) {
                let found = answer(&localizer, shot, heading)?;
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
    /// Figures of the errors of all photos, metres; infinite without an answer.
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
        let flight = ValidationFlight::draw(1003, 3, folder.path()).unwrap();
        let model = Model::bundled().unwrap();
        for _ in 0..2 {
            let [known, unknown] = flight.measure(&model).unwrap();
            assert!(known.heading_known && !unknown.heading_known);
            assert_eq!(known.photos, 3);
            assert!(known.within_20_m > 0.6, "{known:?}");
        }
    }
}
