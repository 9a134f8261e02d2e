//! A track as text.

mod csv;
mod geojson;
#[cfg(feature = "sqlite")]
pub mod gpkg;
mod gpx;
mod jsonl;
mod kml;
mod table;

use std::path::Path;

use anyhow::{Context as _, Result};

use super::line::TrackLine;
use crate::formats::{NOT_TEXT, TextFormat};

/// How a track is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum TrackFormat {
    /// Aligned columns, for reading
    Table,
    /// One JSON object per line
    Jsonl,
    /// Comma-separated values with a header
    Csv,
    /// A GeoJSON feature collection (RFC 7946): a point for each frame
    Geojson,
    /// A GPS exchange file (GPX 1.1): one track, a segment for each part without interruption
    Gpx,
    /// Lines (KML 2.3), for Google Earth and others
    Kml,
    /// A GeoPackage (OGC), for QGIS: positions, the track line and 95 % ellipses as layers; a file, written when the run ends
    #[cfg(feature = "sqlite")]
    Gpkg,
}

impl TrackFormat {
    /// The format that a file's ending names.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_lowercase().as_str() {
            "txt" => Some(Self::Table),
            "jsonl" | "ndjson" | "json" => Some(Self::Jsonl),
            "csv" => Some(Self::Csv),
            "geojson" => Some(Self::Geojson),
            "gpx" => Some(Self::Gpx),
            "kml" => Some(Self::Kml),
            #[cfg(feature = "sqlite")]
            "gpkg" => Some(Self::Gpkg),
            _ => None,
        }
    }

    /// A whole track as one text.
    ///
    /// # Errors
    /// A line cannot be written in this format.
    pub fn text_of<'a>(self, lines: impl IntoIterator<Item = &'a TrackLine>) -> Result<String> {
        let mut format = self.start().context(NOT_TEXT)?;
        let mut text = format.opening();
        for line in lines {
            text += &format.row(line)?;
        }
        Ok(text + format.closing() + &format.summary())
    }

    /// The format for a track; `None` for one that is not text.
    pub fn start(self) -> Option<Box<dyn TextFormat<TrackLine>>> {
        Some(match self {
            Self::Table => Box::<table::Table>::default(),
            Self::Jsonl => Box::new(jsonl::Jsonl),
            Self::Csv => Box::new(csv::Csv),
            Self::Geojson => Box::<geojson::Geojson>::default(),
            Self::Gpx => Box::<gpx::Gpx>::default(),
            Self::Kml => Box::<kml::Kml>::default(),
            #[cfg(feature = "sqlite")]
            Self::Gpkg => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use grimnet_track::{PositionOf, TrackState};

    use super::super::frame_time::Epoch;
    use super::super::line::{FrameNote, FrameResult};
    use super::*;

    fn line(second: f64, place: Option<[f64; 2]>) -> TrackLine {
        let note = FrameNote {
            photo: format!("flight/a & {second}.jpg"),
            frame: if place.is_some() {
                FrameResult::Fix
            } else {
                FrameResult::NoFix
            },
            reason: place.is_none().then(|| "too few matches".to_owned()),
            time_ms: 30.5,
        };
        TrackLine {
            state: if place.is_some() {
                TrackState::Tracking
            } else {
                TrackState::Lost
            },
            lon_deg: place.map(|p| p[0]),
            lat_deg: place.map(|p| p[1]),
            heading_deg: place.map(|_| 90.0),
            radius95_m: place.map(|_| 3.25),
            covariance_en_m2: place.map(|_| [1.0, 0.1, 1.2]),
            age_of_last_fix_s: Some(0.0),
            altitude_amsl_m: place.map(|_| 160.0),
            position_of: place.map(|_| PositionOf::AircraftWithoutAttitude),
            ..TrackLine::new(1_782_036_000.0 + second, Epoch::Unix, None, Some(note))
        }
    }

    fn lines() -> Vec<TrackLine> {
        vec![
            line(0.0, Some([120.0, 24.0])),
            line(0.5, Some([120.1, 24.1])),
            line(1.0, None),
            line(1.5, Some([120.2, 24.2])),
            line(2.0, Some([120.3, 24.3])),
        ]
    }

    fn written(format: TrackFormat, lines: &[TrackLine]) -> String {
        format.text_of(lines).unwrap()
    }

    #[test]
    fn every_format() {
        for (format, name) in [
            (TrackFormat::Table, "track_table"),
            (TrackFormat::Jsonl, "track_jsonl"),
            (TrackFormat::Csv, "track_csv"),
            (TrackFormat::Geojson, "track_geojson"),
            (TrackFormat::Gpx, "track_gpx"),
            (TrackFormat::Kml, "track_kml"),
        ] {
            insta::assert_snapshot!(name, written(format, &lines()));
        }
    }

    #[test]
    fn xml_is_well_formed_after_every_row_and_has_a_part_for_each_stretch() {
        for (format, part, expected) in [
            (TrackFormat::Gpx, "trkseg", [0, 1, 1, 1, 2, 2]),
            // A line has two points at least.
            (TrackFormat::Kml, "LineString", [0, 0, 1, 1, 1, 2]),
        ] {
            for (count, expected) in expected.into_iter().enumerate() {
                let text = written(format, &lines()[..count]);
                let mut reader = quick_xml::Reader::from_str(&text);
                reader.config_mut().check_end_names = true;
                let (mut depth, mut parts) = (0, 0);
                loop {
                    match reader.read_event().unwrap() {
                        quick_xml::events::Event::Start(tag) => {
                            depth += 1;
                            parts += usize::from(tag.name().as_ref() == part);
                        }
                        quick_xml::events::Event::End(_) => depth -= 1,
                        quick_xml::events::Event::Eof => break,
                        _ => {}
                    }
                }
                assert_eq!(depth, 0, "{text}");
                assert_eq!(parts, expected, "{text}");
            }
        }
    }

    #[test]
    fn endings_name_formats() {
        let of = |name: &str| TrackFormat::of(Path::new(name));
        assert_eq!(of("a.GPX"), Some(TrackFormat::Gpx));
        assert_eq!(of("a.b.geojson"), Some(TrackFormat::Geojson));
        assert_eq!(of("a"), None);
        assert_eq!(of("a.shp"), None);
    }
}
