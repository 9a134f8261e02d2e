//! Answers as other programs read them.
//!
//! An [`Answer`] is what a localiser found for one photo, with the field names that scripts rely on. An [`AnswerFormat`] writes
//! answers one by one as text: [`Jsonl`], [`Geojson`], [`Kml`], [`Gpx`], [`Csv`]. [`text_of`] writes them all at once. With the feature
//! `geopackage`, `geopackage_of` writes them as a GeoPackage. [`GpxTrack`] and [`KmlTrack`] write the positions of a flight, and with the
//! same feature `track_geopackage_of`; [`track_lines`] are their lines for GeoJSON.
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod answer;
mod antimeridian;
mod csv;
mod error;
mod format;
mod geojson;
#[cfg(feature = "geopackage")]
mod geopackage;
#[cfg(feature = "geopackage")]
mod geopackage_file;
#[cfg(feature = "geopackage")]
mod geopackage_geometry;
mod gpx;
mod jsonl;
mod kml;
mod printable;
mod rounding;
#[cfg(feature = "geopackage")]
mod track_geopackage;
mod track_parts;
mod xml;

pub use answer::{Answer, State};
pub use csv::Csv;
pub use error::AnswerError;
pub use format::{AnswerFormat, heading_or_dash, or_dash, text_of};
pub use geojson::Geojson;
#[cfg(feature = "geopackage")]
pub use geopackage::geopackage_of;
pub use gpx::Gpx;
pub use jsonl::Jsonl;
pub use kml::Kml;
pub use printable::{printable, printable_text};
pub use rounding::{rounded, rounded_heading};
#[cfg(feature = "geopackage")]
pub use track_geopackage::{TrackRecord, track_geopackage_of};
pub use track_parts::{GpxTrack, KmlTrack, TrackPlace, track_lines};

#[cfg(test)]
mod tests {
    use super::*;

    fn answers() -> [Answer; 2] {
        let fix = Answer {
            photo: "flight/a & b.jpg".into(),
            state: State::Fix,
            lat_deg: Some(24.261_918_45),
            lon_deg: Some(120.720_283_91),
            heading_deg: Some(152.1),
            gsd_m: Some(0.12),
            radius95_m: Some(2.5),
            covariance_en_m2: Some([1.0, 0.1, 1.2]),
            confidence: Some(0.97),
            inliers: Some(41),
            time_ms: [("total".to_owned(), 37.0)].into(),
            matches: Some(96),
            check_m: Some(3.4),
            outline_lon_lat_deg: Some(vec![
                [120.0, 24.0],
                [121.0, 24.0],
                [121.0, 23.0],
                [120.0, 23.0],
            ]),
            ..Answer::default()
        };
        [fix, Answer::no_fix("c\x1b[2J.jpg", "too few matches")]
    }

    fn written(mut format: impl AnswerFormat) -> String {
        text_of(&mut format, &answers()).unwrap()
    }

    #[test]
    fn jsonl() {
        insta::assert_snapshot!(written(Jsonl));
    }

    #[test]
    fn answers_are_read_back_from_their_lines() {
        let text = written(Jsonl);
        let read = text.lines().map(|line| serde_json::from_str(line).unwrap());
        assert_eq!(read.collect::<Vec<Answer>>(), answers());
    }

    #[test]
    fn csv() {
        insta::assert_snapshot!(written(Csv));
    }

    #[test]
    fn geojson() {
        let text = written(Geojson::default());
        let collection: ::geojson::FeatureCollection = text.parse().unwrap();
        assert_eq!(
            collection.features.len(),
            3,
            "a point and an outline for the fix, a feature for the miss"
        );
        insta::assert_snapshot!(text);
    }

    /// An answer whose outline crosses the antimeridian.
    fn answer_across_the_antimeridian() -> Answer {
        let mut answer = answers()[0].clone();
        answer.lon_deg = Some(-179.999_95);
        answer.outline_lon_lat_deg = Some(vec![
            [179.999, 24.001],
            [-179.9991, 24.001],
            [-179.9991, 24.0],
            [179.9995, 24.0],
        ]);
        answer
    }

    /// The longitudes of each line of a KML text, degrees.
    pub(crate) fn longitudes_of_lines(text: &str) -> Vec<Vec<f64>> {
        let lines = text.split("<LineString>").skip(1);
        let coordinates = lines.map(|line| {
            let (_, rest) = line.split_once("<coordinates>").unwrap();
            rest.split_once('<').unwrap().0.split_whitespace()
        });
        let longitude = |point: &str| point.split(',').next().unwrap().parse().unwrap();
        coordinates
            .map(|points| points.map(longitude).collect())
            .collect()
    }

    #[test]
    fn an_outline_across_the_antimeridian_is_cut_in_kml() {
        let text = text_of(&mut Kml, &[answer_across_the_antimeridian()]).unwrap();
        assert_eq!(
            longitudes_of_lines(&text),
            [
                vec![179.999, 180.0],
                vec![-180.0, -179.9991, -179.9991, -180.0],
                vec![180.0, 179.9995, 179.999],
            ]
        );
    }

    #[test]
    fn an_outline_across_the_antimeridian_is_two_polygons_of_geojson() {
        let answer = answer_across_the_antimeridian();
        let text = text_of(&mut Geojson::default(), &[answer]).unwrap();
        let collection: ::geojson::FeatureCollection = text.parse().unwrap();
        let geometry = collection.features[1].geometry.as_ref().unwrap();
        let ::geojson::GeometryValue::MultiPolygon { coordinates } = &geometry.value else {
            panic!("{text}")
        };
        let mut sizes = Vec::new();
        for polygon in coordinates {
            let ring = &polygon[0];
            assert_eq!(ring.first(), ring.last());
            let lons: Vec<f64> = ring.iter().map(|at| at[0]).collect();
            assert!(lons.iter().all(|lon| lon.signum() == lons[0].signum()));
            assert!(lons.iter().all(|lon| (179.9..=180.0).contains(&lon.abs())));
            // Twice the area by the shoelace formula; positive is counter-clockwise.
            sizes.push(
                ring.windows(2)
                    .map(|p| p[0][0] * p[1][1] - p[1][0] * p[0][1])
                    .sum::<f64>(),
            );
        }
        // Together the trapezoid with sides of 0.0019 and 0.0014 degrees.
        assert_eq!(sizes.len(), 2);
        assert!(sizes.iter().all(|size| *size > 0.0), "{sizes:?}");
        assert!(
            (sizes.iter().sum::<f64>() - 3.3e-6).abs() < 1e-8,
            "{sizes:?}"
        );
    }

    #[test]
    fn kml() {
        let text = written(Kml);
        assert_eq!(text.matches("<Placemark>").count(), 2, "a miss is one too");
        insta::assert_snapshot!(text);
    }

    #[test]
    fn gpx() {
        let text = written(Gpx);
        assert_eq!(
            text.matches("<wpt ").count(),
            1,
            "a waypoint has a position, so a miss is none"
        );
        insta::assert_snapshot!(text);
    }
}
