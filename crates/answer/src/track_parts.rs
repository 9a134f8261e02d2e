//! Tracks as GPX 1.1 and as OGC KML 2.3, written point by point: where the position is not known, one part ends, and the next point
//! begins another.

use std::fmt::Write as _;

use quick_xml::escape::escape;

use crate::printable::printable_text;

/// A point of a track whose position is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPlace<'a> {
    /// Degrees, WGS 84.
    pub lon_deg: f64,
    /// Degrees, WGS 84.
    pub lat_deg: f64,
    /// Metres above mean sea level.
    pub altitude_amsl_m: Option<f64>,
    /// RFC 3339, if the time of day is known.
    pub time: Option<&'a str>,
}

/// Which part of a track is open.
#[derive(Debug, Clone, Copy, Default)]
struct Parts {
    is_open: bool,
    is_interrupted: bool,
}

impl Parts {
    /// What comes before the next point, if there is one: the end of the part before, and the beginning of another.
    fn next(&mut self, has_place: bool, begin: &str, end: &str) -> String {
        let mut text = String::new();
        if !has_place {
            self.is_interrupted = true;
            return text;
        }
        if self.is_open && self.is_interrupted {
            text += end;
            self.is_open = false;
        }
        if !self.is_open {
            text += begin;
            self.is_open = true;
        }
        self.is_interrupted = false;
        text
    }
}

/// Writes a track as GPX: one track with a segment for each part.
#[derive(Debug, Clone, Default)]
pub struct GpxTrack {
    /// Name of the track, if it has one.
    pub name: Option<String>,
    parts: Parts,
}

impl GpxTrack {
    /// A track with a name.
    #[must_use]
    pub fn named(name: impl Into<String>) -> Self {
        Self {
            name: Some(name.into()),
            ..Self::default()
        }
    }

    /// What comes before the first point.
    #[must_use]
    pub fn opening(&self) -> String {
        let name = self.name.as_deref().map_or_else(String::new, |name| {
            format!("<name>{}</name>\n", escape(printable_text(name).as_ref()))
        });
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
             <gpx version=\"1.1\" creator=\"grimnet\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n\
             <trk>\n{name}"
        )
    }

    /// The next point; `None` where the position is not known.
    #[must_use]
    pub fn point(&mut self, place: Option<TrackPlace<'_>>) -> String {
        let mut text = self
            .parts
            .next(place.is_some(), "<trkseg>\n", "</trkseg>\n");
        let Some(place) = place else { return text };
        let TrackPlace {
            lat_deg, lon_deg, ..
        } = place;
        // Writing to a string does not fail, here and below.
        let _ = write!(text, "<trkpt lat=\"{lat_deg:.8}\" lon=\"{lon_deg:.8}\">");
        if let Some(altitude_m) = place.altitude_amsl_m {
            let _ = write!(text, "<ele>{altitude_m:.2}</ele>");
        }
        if let Some(time) = place.time {
            let _ = write!(text, "<time>{time}</time>");
        }
        text + "</trkpt>\n"
    }

    /// What comes after the last point.
    #[must_use]
    pub fn closing(&self) -> &'static str {
        if self.parts.is_open {
            "</trkseg>\n</trk>\n</gpx>\n"
        } else {
            "</trk>\n</gpx>\n"
        }
    }
}

/// Writes a track as KML: one placemark with a line for each part.
#[derive(Debug, Clone, Copy, Default)]
pub struct KmlTrack {
    parts: Parts,
}

impl KmlTrack {
    /// What comes before the first point.
    #[must_use]
    pub fn opening(&self) -> &'static str {
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <kml xmlns=\"http://www.opengis.net/kml/2.2\">\n\
         <Document>\n\
         <name>grimnet</name>\n\
         <Placemark>\n\
         <name>track</name>\n\
         <MultiGeometry>\n"
    }

    /// The next point; `None` where the position is not known.
    #[must_use]
    pub fn point(&mut self, place: Option<TrackPlace<'_>>) -> String {
        let mut text = self.parts.next(
            place.is_some(),
            "<LineString><tessellate>1</tessellate><coordinates>\n",
            "</coordinates></LineString>\n",
        );
        if let Some(TrackPlace {
            lon_deg, lat_deg, ..
        }) = place
        {
            let _ = writeln!(text, "{lon_deg:.8},{lat_deg:.8}");
        }
        text
    }

    /// What comes after the last point.
    #[must_use]
    pub fn closing(&self) -> &'static str {
        if self.parts.is_open {
            "</coordinates></LineString>\n</MultiGeometry>\n</Placemark>\n</Document>\n</kml>\n"
        } else {
            "</MultiGeometry>\n</Placemark>\n</Document>\n</kml>\n"
        }
    }
}
