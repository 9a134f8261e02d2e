//! A track as a GeoPackage, for QGIS and GDAL: positions as points, their 95 % ellipses as polygons, and the way as lines.

use rusqlite::ToSql;

use crate::antimeridian::beside;
use crate::error::Result;
use crate::geopackage_file::{GeoPackage, Layer};
use crate::geopackage_geometry::Geometry;
use crate::track_parts::{TrackPlace, lines};

const POSITIONS: usize = 0;
const WAY: usize = 1;
const ELLIPSES: usize = 2;

static LAYERS: [Layer; 3] = [
    Layer {
        name: "positions",
        geometry: "POINT",
        description: "position at each instant; instants without a usable position have no geometry",
        columns: &[
            ("time", "TEXT"),
            ("photo", "TEXT"),
            ("state", "TEXT"),
            ("frame", "TEXT"),
            ("heading_deg", "DOUBLE"),
            ("radius95_m", "DOUBLE"),
            ("variance_east_m2", "DOUBLE"),
            ("covariance_east_north_m2", "DOUBLE"),
            ("variance_north_m2", "DOUBLE"),
            ("velocity_east_m_s", "DOUBLE"),
            ("velocity_north_m_s", "DOUBLE"),
            ("altitude_amsl_m", "DOUBLE"),
            ("age_of_last_fix_s", "DOUBLE"),
            ("reason", "TEXT"),
            ("position_of", "TEXT"),
        ],
    },
    Layer {
        name: "track",
        geometry: "LINESTRING",
        description: "the way, a line for each part of two points or more without interruption",
        columns: &[("first_time", "TEXT"), ("last_time", "TEXT")],
    },
    Layer {
        name: "ellipses95",
        geometry: "POLYGON",
        description: "ellipse of each position that should hold the truth in 95 % of cases",
        columns: &[
            ("time", "TEXT"),
            ("photo", "TEXT"),
            ("state", "TEXT"),
            ("radius95_m", "DOUBLE"),
        ],
    },
];

/// One instant of a track.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TrackRecord<'a> {
    /// RFC 3339, or seconds.
    pub time: &'a str,
    /// The photo, or nothing.
    pub photo: &'a str,
    /// `searching`, `tracking`, `coasting`, `ambiguous` or `lost`.
    pub state: &'a str,
    /// What the photo gave alone: `fix`, `no_fix` or `unusable`.
    pub frame: Option<&'a str>,
    /// The position, if it may be used.
    pub place: Option<TrackPlace<'a>>,
    /// Degrees clockwise from true north.
    pub heading_deg: Option<f64>,
    /// Radius that should hold the truth in 95 % of cases, metres.
    pub radius95_m: Option<f64>,
    /// Covariance, square metres: east-east, east-north, north-north.
    pub covariance_en_m2: Option<[f64; 3]>,
    /// Velocity to the east and to the north, metres per second.
    pub velocity_en_m_s: [Option<f64>; 2],
    /// Seconds since the last fix that was accepted.
    pub age_of_last_fix_s: Option<f64>,
    /// Why the photo has no fix.
    pub reason: Option<&'a str>,
    /// What point the position is of: `aircraft`, `aircraft_without_attitude` or `image_centre`.
    pub position_of: Option<&'a str>,
}

/// A track as the bytes of a GeoPackage with the layers `positions`, `track` and `ellipses95`, in EPSG:4326.
///
/// # Errors
/// Returns [`crate::AnswerError::Database`] if SQLite fails, which takes a lack of memory.
pub fn track_geopackage_of<'a>(
    records: impl IntoIterator<Item = TrackRecord<'a>>,
) -> Result<Vec<u8>> {
    let mut file = GeoPackage::new(&LAYERS)?;
    let records: Vec<TrackRecord<'a>> = records.into_iter().collect();
    for record in &records {
        add(&mut file, record)?;
    }
    for part in lines(&records, |record| record.place.is_some()) {
        add_way(&mut file, part)?;
    }
    file.finish()
}

fn add(file: &mut GeoPackage, record: &TrackRecord<'_>) -> Result<()> {
    let position = record.place.map(|place| [place.lon_deg, place.lat_deg]);
    let covariance = record.covariance_en_m2;
    let point = position.map(Geometry::Point);
    file.add(
        POSITIONS,
        point.as_ref(),
        &[
            &record.time,
            &record.photo,
            &record.state,
            &record.frame,
            &record.heading_deg,
            &record.radius95_m,
            &covariance.map(|c| c[0]),
            &covariance.map(|c| c[1]),
            &covariance.map(|c| c[2]),
            &record.velocity_en_m_s[0],
            &record.velocity_en_m_s[1],
            &record.place.and_then(|place| place.altitude_amsl_m),
            &record.age_of_last_fix_s,
            &record.reason,
            &record.position_of,
        ],
    )?;
    if let (Some(position), Some(covariance)) = (position, covariance) {
        let ellipse = Geometry::ellipse95(position, covariance);
        let values: [&dyn ToSql; 4] = [
            &record.time,
            &record.photo,
            &record.state,
            &record.radius95_m,
        ];
        file.add(ELLIPSES, Some(&ellipse), &values)?;
    }
    Ok(())
}

/// Adds a part of the way without interruption.
fn add_way(file: &mut GeoPackage, part: &[TrackRecord<'_>]) -> Result<()> {
    let mut points: Vec<[f64; 2]> = Vec::with_capacity(part.len());
    for place in part.iter().filter_map(|record| record.place) {
        let before = points.last().map_or(place.lon_deg, |point| point[0]);
        points.push([beside(place.lon_deg, before), place.lat_deg]);
    }
    let times = [part.first(), part.last()].map(|record| record.map(|record| record.time));
    file.add(WAY, Some(&Geometry::Line(points)), &[&times[0], &times[1]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;
    use std::process::Command;

    fn record(time: &str, place: Option<[f64; 2]>) -> TrackRecord<'_> {
        TrackRecord {
            time,
            photo: "a.jpg",
            state: if place.is_some() { "tracking" } else { "lost" },
            frame: Some("fix"),
            place: place.map(|[lon_deg, lat_deg]| TrackPlace {
                lon_deg,
                lat_deg,
                altitude_amsl_m: Some(160.5),
                time: None,
            }),
            covariance_en_m2: place.map(|_| [1.0, 0.25, 1.0]),
            radius95_m: place.map(|_| 2.5),
            position_of: place.map(|_| "image_centre"),
            ..TrackRecord::default()
        }
    }

    /// Two parts with a line, and one of a single point.
    fn records() -> [TrackRecord<'static>; 7] {
        [
            record("10:00", Some([120.5, 24.5])),
            record("10:01", Some([120.75, 24.5])),
            record("10:02", None),
            record("10:03", Some([121.0, 24.25])),
            record("10:04", None),
            record("10:05", Some([121.0, 24.0])),
            record("10:06", Some([121.25, 24.0])),
        ]
    }

    #[test]
    fn sqlite_reads_it() {
        let bytes = track_geopackage_of(records()).unwrap();
        let mut base = rusqlite::Connection::open_in_memory().unwrap();
        base.deserialize_read_exact("main", &bytes[..], bytes.len(), true)
            .unwrap();
        let count = |sql: &str| -> i64 { base.query_row(sql, [], |row| row.get(0)).unwrap() };
        assert_eq!(count("SELECT count(*) FROM positions"), 7);
        assert_eq!(
            count("SELECT count(*) FROM positions WHERE geom IS NULL"),
            2
        );
        assert_eq!(count("SELECT count(*) FROM ellipses95"), 5);
        assert_eq!(count("SELECT count(*) FROM track"), 2);
        let times: (String, String) = base
            .query_row(
                "SELECT first_time, last_time FROM track WHERE fid = 2",
                [],
                |row| Ok((row.get(0)?, row.get(1)?)),
            )
            .unwrap();
        assert_eq!(times, ("10:05".to_owned(), "10:06".to_owned()));
        assert!(track_geopackage_of([]).is_ok());
    }

    #[test]
    fn a_line_goes_on_beyond_the_antimeridian() {
        let records = [
            record("10:00", Some([-179.5, 24.0])),
            record("10:01", Some([179.5, 24.0])),
            record("10:02", Some([-179.75, 24.0])),
        ];
        let bytes = track_geopackage_of(records).unwrap();
        let mut base = rusqlite::Connection::open_in_memory().unwrap();
        base.deserialize_read_exact("main", &bytes[..], bytes.len(), true)
            .unwrap();
        let edges: (f64, f64) = base
            .query_row(
                "SELECT min_x, max_x FROM gpkg_contents WHERE table_name = 'track'",
                [],
                |row| Ok((row.get(0)?, row.get(1)?)),
            )
            .unwrap();
        assert_eq!(edges, (-180.5, -179.5));
    }

    #[test]
    fn gdal_reads_it() {
        let mut file = tempfile::Builder::new().suffix(".gpkg").tempfile().unwrap();
        file.write_all(&track_geopackage_of(records()).unwrap())
            .unwrap();
        let ogrinfo = Command::new("ogrinfo")
            .args(["-ro", "-al"])
            .arg(file.path())
            .output();
        let Ok(output) = ogrinfo else {
            let _ = writeln!(
                std::io::stderr(),
                "SKIPPED: GDAL's ogrinfo is not installed"
            );
            return;
        };
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && errors.is_empty(), "{errors}");
        for words in [
            "Layer name: positions",
            "Geometry: Line String",
            "LINESTRING (120.5 24.5,120.75 24.5)",
            "state (String) = tracking",
            "altitude_amsl_m (Real) = 160.5",
            "position_of (String) = image_centre",
            "Extent: (120.500000, 24.000000) - (121.250000, 24.500000)",
        ] {
            assert!(text.contains(words), "{words} is not in\n{text}");
        }
    }
}
