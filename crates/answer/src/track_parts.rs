//! The parts of a track: where the position is not known, one ends, and the next point begins another. With GPX 1.1 and OGC KML 2.3, which
//! are written point by point.

use std::fmt::Write as _;

use quick_xml::escape::escape;

use crate::antimeridian::cut_line;
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

/// The parts of a track that have the two points of a line.
pub(crate) fn lines<T>(track: &[T], has_place: impl Fn(&T) -> bool) -> impl Iterator<Item = &[T]> {
    let parts = track.split(move |at| !has_place(at));
    parts.filter(|part| part.len() > 1)
}

/// The lines of a track as GeoJSON has them, for a `MultiLineString`: `[lon, lat]` in degrees from the positions of a flight, `None` where
/// the position is not known. There is one for each part of two points or more, and a line that crosses the antimeridian is cut there
/// (RFC 7946, 3.1.9).
#[must_use]
pub fn track_lines(positions: &[Option<[f64; 2]>]) -> Vec<Vec<[f64; 2]>> {
    let parts = lines(positions, Option::is_some);
    parts
        .flat_map(|part| cut_line(&part.iter().flatten().copied().collect::<Vec<_>>()))
        .collect()
}

const GPX_SEGMENT_END: &str = "</trkseg>\n";
const KML_LINE: &str = "<LineString><tessellate>1</tessellate><coordinates>\n";
const KML_LINE_END: &str = "</coordinates></LineString>\n";

/// Writes a track as GPX: one track with a segment for each part.
#[derive(Debug, Clone, Default)]
pub struct GpxTrack {
    /// Name of the track, if it has one.
    pub name: Option<String>,
    is_in_segment: bool,
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
        let was_in_segment = std::mem::replace(&mut self.is_in_segment, place.is_some());
        let Some(place) = place else {
            return if was_in_segment { GPX_SEGMENT_END } else { "" }.to_owned();
        };
        let mut text = if was_in_segment { "" } else { "<trkseg>\n" }.to_owned();
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
        if self.is_in_segment {
            "</trkseg>\n</trk>\n</gpx>\n"
        } else {
            "</trk>\n</gpx>\n"
        }
    }
}

/// Writes a track as KML: one placemark with a line for each part, cut where it crosses the antimeridian: what draws longitudes as they
/// are would draw it around the whole earth. A part of a single point is left out: a line has two at least.
#[derive(Debug, Clone, Copy, Default)]
pub struct KmlTrack {
    part: KmlPart,
}

/// What there is of the part of the last point.
#[derive(Debug, Clone, Copy, Default)]
enum KmlPart {
    /// The position is not known.
    #[default]
    None,
    /// A first point, longitude and latitude in degrees, which waits for a second.
    Point([f64; 2]),
    /// A line, which is open, with its last point.
    Line([f64; 2]),
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

    /// What the next point adds; `None` where the position is not known.
    #[must_use]
    pub fn point(&mut self, place: Option<TrackPlace<'_>>) -> String {
        let place = place.map(|place| [place.lon_deg, place.lat_deg]);
        let (KmlPart::Point(before) | KmlPart::Line(before), Some(place)) = (self.part, place)
        else {
            let was_in_line = matches!(self.part, KmlPart::Line(_));
            self.part = place.map_or(KmlPart::None, KmlPart::Point);
            return if was_in_line { KML_LINE_END } else { "" }.to_owned();
        };
        let mut text = String::new();
        for piece in cut_line(&[before, place]) {
            for (number, at) in piece.into_iter().enumerate() {
                match self.part {
                    KmlPart::Line(last) if number == 0 && last == at => continue,
                    KmlPart::Line(_) if number == 0 => text = text + KML_LINE_END + KML_LINE,
                    KmlPart::Line(_) => {}
                    KmlPart::Point(_) | KmlPart::None => text += KML_LINE,
                }
                let [lon_deg, lat_deg] = at;
                // Writing to a string does not fail.
                let _ = writeln!(text, "{lon_deg:.8},{lat_deg:.8}");
                self.part = KmlPart::Line(at);
            }
        }
        text
    }

    /// What comes after the last point.
    #[must_use]
    pub fn closing(&self) -> &'static str {
        match self.part {
            KmlPart::Line(_) => {
                "</coordinates></LineString>\n</MultiGeometry>\n</Placemark>\n</Document>\n</kml>\n"
            }
            KmlPart::None | KmlPart::Point(_) => {
                "</MultiGeometry>\n</Placemark>\n</Document>\n</kml>\n"
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two parts with a line, and two of a single point, the last one at the end.
    const POSITIONS: [Option<[f64; 2]>; 9] = [
        Some([120.5, 24.5]),
        Some([120.75, 24.5]),
        None,
        Some([121.0, 24.25]),
        None,
        Some([179.5, 24.0]),
        Some([-179.5, 24.0]),
        None,
        Some([121.25, 24.0]),
    ];

    /// The track's text after each of its points, closed.
    fn texts(
        opening: &str,
        mut point: impl FnMut(Option<TrackPlace<'_>>) -> (String, &'static str),
    ) -> Vec<String> {
        let mut text = opening.to_owned();
        POSITIONS
            .map(|position| {
                let place = position.map(|[lon_deg, lat_deg]| TrackPlace {
                    lon_deg,
                    lat_deg,
                    altitude_amsl_m: None,
                    time: None,
                });
                let (more, closing) = point(place);
                text += &more;
                text.clone() + closing
            })
            .into()
    }

    /// A file is closed after every point, and the next one overwrites what closed it: a shorter text would leave some of that behind.
    fn assert_none_is_shorter_than_the_one_before(texts: &[String]) {
        for pair in texts.windows(2) {
            assert!(pair[0].len() <= pair[1].len(), "{}\n{}", pair[0], pair[1]);
        }
    }

    #[test]
    fn lines_of_kml_have_two_points_at_least() {
        let mut track = KmlTrack::default();
        let texts = texts(track.opening(), |place| {
            let text = track.point(place);
            (text, track.closing())
        });
        for (text, lines) in texts.iter().zip([0, 1, 1, 1, 1, 1, 3, 3, 3]) {
            for tag in ["LineString", "coordinates", "MultiGeometry", "kml"] {
                let begun = text.matches(&format!("<{tag}")).count();
                assert_eq!(begun, text.matches(&format!("</{tag}>")).count(), "{text}");
            }
            let written = text.split("<coordinates>\n").skip(1);
            let points = written.map(|rest| rest.split("</").next().unwrap().lines().count());
            assert_eq!(points.collect::<Vec<_>>(), vec![2; lines], "{text}");
        }
        assert_none_is_shorter_than_the_one_before(&texts);
    }

    #[test]
    fn lines_of_kml_are_cut_at_the_antimeridian() {
        let mut track = KmlTrack::default();
        let mut text = String::new();
        // There, back, and to the antimeridian under both of its names.
        for lon_deg in [179.0, 179.5, -179.5, -179.0, 179.0, -180.0, -179.0] {
            text += &track.point(Some(TrackPlace {
                lon_deg,
                lat_deg: 24.0,
                altitude_amsl_m: None,
                time: None,
            }));
        }
        text += track.closing();
        assert_eq!(
            crate::tests::longitudes_of_lines(&text),
            [
                vec![179.0, 179.5, 180.0],
                vec![-180.0, -179.5, -179.0, -180.0],
                vec![180.0, 179.0, 180.0],
                vec![-180.0, -179.0],
            ]
        );
    }

    #[test]
    fn segments_of_gpx_have_every_point() {
        let mut track = GpxTrack::default();
        let texts = texts(&track.opening(), |place| {
            let text = track.point(place);
            (text, track.closing())
        });
        for (text, segments) in texts.iter().zip([1, 1, 1, 2, 2, 3, 3, 3, 4]) {
            for tag in ["<trkseg>", "</trkseg>"] {
                assert_eq!(text.matches(tag).count(), segments, "{text}");
            }
        }
        assert_eq!(texts[8].matches("<trkpt ").count(), 6);
        assert_none_is_shorter_than_the_one_before(&texts);
    }

    #[test]
    fn lines_of_geojson_are_cut_at_the_antimeridian() {
        let expected = [
            [[120.5, 24.5], [120.75, 24.5]],
            [[179.5, 24.0], [180.0, 24.0]],
            [[-180.0, 24.0], [-179.5, 24.0]],
        ];
        assert_eq!(track_lines(&POSITIONS), expected);
    }
}
