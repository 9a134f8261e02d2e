//! How far a track is from the truth.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Result, bail};
use grimnet_eval::datasets::truth::{self, TruthFrame};
use grimnet_geo::LonLat;
use grimnet_track::measure::{Instant, Measure, TrackSummary};
use grimnet_track::{PositionOf, TrackPoint};

/// True positions by file name.
pub struct Truth {
    of_photo: HashMap<String, TruthFrame>,
}

/// The comparison of one frame.
#[derive(Debug, Clone, Copy)]
pub struct Compared {
    /// Where it was.
    pub truth: LonLat,
    /// With what was answered.
    pub instant: Instant,
}

impl Truth {
    /// Reads a table with a column `photo`, and the aircraft's position (`gps_lat`, `gps_lon`) or that of the image centre
    /// (`lat_deg`, `lon_deg`).
    ///
    /// # Errors
    /// The table cannot be read or holds nothing.
    pub fn read(path: &Path) -> Result<Self> {
        let frames = truth::read(path)?;
        if frames.is_empty() {
            bail!("{}: holds no true position", path.display());
        }
        Ok(Self {
            of_photo: frames
                .into_iter()
                .map(|frame| (frame.photo.clone(), frame))
                .collect(),
        })
    }

    /// Compares the track at a frame; `None` if the truth of that photo is not known.
    pub fn compare(
        &self,
        photo: &str,
        time_s: f64,
        point: Option<&TrackPoint>,
    ) -> Option<Compared> {
        let name = Path::new(photo).file_name()?.to_str()?;
        let frame = self.of_photo.get(name)?;
        let estimate = point.and_then(|point| point.estimate.as_ref());
        let of_centre = estimate.is_some_and(|e| e.position_of == PositionOf::ImageCentre);
        let truth = if of_centre {
            frame.position()
        } else {
            frame.receiver().or_else(|| frame.position())
        }?;
        Some(Compared {
            truth,
            instant: Instant::of(point, time_s, truth),
        })
    }
}

/// Figures over a flight.
pub fn summary(compared: &[Compared]) -> TrackSummary {
    let mut measure = Measure::default();
    let instants: Vec<Instant> = compared.iter().map(|compared| compared.instant).collect();
    measure.add_flight(&instants);
    measure.summary()
}
