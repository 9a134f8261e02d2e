//! A track as NMEA sentences in a file: GGA and RMC for each frame with a usable position.

use anyhow::Result;
use grimnet_link::{MAX_RADIUS95_M, nmea_sentences};
use grimnet_track::TrackPoint;

use crate::formats::TextFormat;

/// See the module.
pub struct NmeaRows;

impl TextFormat<TrackPoint> for NmeaRows {
    fn row(&mut self, point: &TrackPoint) -> Result<String> {
        Ok(nmea_sentences(point, MAX_RADIUS95_M).unwrap_or_default())
    }
}
