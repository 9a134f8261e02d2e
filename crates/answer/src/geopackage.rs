//! A GeoPackage (OGC 12-128r18, version 1.3) for QGIS and GDAL: fixes as points, outlines and 95 % ellipses as polygons.

use grimnet_geo::{LonLat, destination};
use rusqlite::Connection;

use crate::answer::{Answer, State};
use crate::error::Result;

/// EPSG:4326, of all layers.
const SRS_ID: i32 = 4326;
/// "GPKG" as a number, and the version (OGC 12-128r18, requirement 2).
const APPLICATION_ID: i32 = 0x4750_4B47;
const USER_VERSION: i32 = 10_300;
/// Points of an ellipse.
const ELLIPSE_POINTS: usize = 64;
/// Radius of the circle that holds 95 % of a normal distribution in the plane, standard deviations: sqrt(-2 ln 0.05).
const SIGMAS_95: f64 = 2.447_746_830_680_816;

const WKT_4326: &str = r#"GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AXIS["Latitude",NORTH],AXIS["Longitude",EAST],AUTHORITY["EPSG","4326"]]"#;

/// Tables that every GeoPackage has (OGC 12-128r18, annex C).
const TABLES: &str = "
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL,
  z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE fixes (
  fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT, photo TEXT, state TEXT, heading_deg DOUBLE, gsd_m DOUBLE,
  radius95_m DOUBLE, variance_east_m2 DOUBLE, covariance_east_north_m2 DOUBLE, variance_north_m2 DOUBLE, confidence DOUBLE,
  inliers INTEGER, reason TEXT);
CREATE TABLE outlines (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POLYGON, photo TEXT);
CREATE TABLE ellipses95 (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POLYGON, photo TEXT, radius95_m DOUBLE);
";

/// Layers, their geometry, and what they are.
const LAYERS: [(&str, &str, &str); 3] = [
    (
        "fixes",
        "POINT",
        "image centre of each photo; photos without a fix have no geometry",
    ),
    ("outlines", "POLYGON", "outline of each photo on the ground"),
    (
        "ellipses95",
        "POLYGON",
        "ellipse of each fix that should hold the truth in 95 % of cases",
    ),
];

/// All answers as the bytes of a GeoPackage with the layers `fixes`, `outlines` and `ellipses95`, in EPSG:4326.
///
/// # Errors
/// Returns [`crate::AnswerError::Database`] if SQLite fails, which takes a lack of memory.
pub fn geopackage_of<'a>(answers: impl IntoIterator<Item = &'a Answer>) -> Result<Vec<u8>> {
    let mut base = Connection::open_in_memory()?;
    base.pragma_update(None, "application_id", APPLICATION_ID)?;
    base.pragma_update(None, "user_version", USER_VERSION)?;
    let transaction = base.transaction()?;
    transaction.execute_batch(TABLES)?;
    add_systems(&transaction)?;
    let mut bounds = [Bounds::default(); 3];
    for answer in answers {
        add(&transaction, answer, &mut bounds)?;
    }
    for ((name, kind, description), bounds) in LAYERS.iter().zip(bounds) {
        let [west, south, east, north] = bounds.edges();
        transaction.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, min_x, min_y, max_x, max_y, srs_id) \
             VALUES (?1, 'features', ?1, ?2, ?3, ?4, ?5, ?6, ?7)",
            (name, description, west, south, east, north, SRS_ID),
        )?;
        transaction.execute(
            "INSERT INTO gpkg_geometry_columns VALUES (?1, 'geom', ?2, ?3, 0, 0)",
            (name, kind, SRS_ID),
        )?;
    }
    transaction.commit()?;
    Ok(base.serialize("main")?.to_vec())
}

fn add_systems(base: &Connection) -> Result<()> {
    let systems = [
        ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined"),
        ("Undefined geographic SRS", 0, "NONE", 0, "undefined"),
        ("WGS 84 geodetic", SRS_ID, "EPSG", SRS_ID, WKT_4326),
    ];
    for system in systems {
        base.execute(
            "INSERT INTO gpkg_spatial_ref_sys (srs_name, srs_id, organization, organization_coordsys_id, definition) \
             VALUES (?1, ?2, ?3, ?4, ?5)",
            system,
        )?;
    }
    Ok(())
}

fn add(base: &Connection, answer: &Answer, bounds: &mut [Bounds; 3]) -> Result<()> {
    let position = answer
        .lon_deg
        .zip(answer.lat_deg)
        .filter(|_| answer.state == State::Fix);
    let point = position.map(|(lon, lat)| {
        bounds[0].add([lon, lat]);
        point_blob([lon, lat])
    });
    let covariance = answer.covariance_en_m2;
    let state = match answer.state {
        State::Fix => "fix",
        State::NoFix => "no_fix",
    };
    base.execute(
        "INSERT INTO fixes (geom, photo, state, heading_deg, gsd_m, radius95_m, variance_east_m2, covariance_east_north_m2, \
         variance_north_m2, confidence, inliers, reason) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
        rusqlite::params![
            point,
            answer.photo,
            state,
            answer.heading_deg,
            answer.gsd_m,
            answer.radius95_m,
            covariance.map(|c| c[0]),
            covariance.map(|c| c[1]),
            covariance.map(|c| c[2]),
            answer.confidence,
            answer.inliers.map(|n| n as i64),
            answer.reason,
        ],
    )?;
    if let Some(outline) = &answer.outline_lon_lat_deg {
        let polygon = polygon_blob(outline, &mut bounds[1]);
        base.execute(
            "INSERT INTO outlines (geom, photo) VALUES (?1, ?2)",
            (polygon, &answer.photo),
        )?;
    }
    if let (Some((lon, lat)), Some(covariance)) = (position, covariance) {
        let ring = ellipse(LonLat::new(lon, lat), covariance);
        let polygon = polygon_blob(&ring, &mut bounds[2]);
        base.execute(
            "INSERT INTO ellipses95 (geom, photo, radius95_m) VALUES (?1, ?2, ?3)",
            (polygon, &answer.photo, answer.radius95_m),
        )?;
    }
    Ok(())
}

/// The ellipse that holds 95 % of a normal distribution with this covariance (east-east, east-north, north-north, square
/// metres), as longitudes and latitudes, anticlockwise. It is not closed.
fn ellipse(centre: LonLat, [east, both, north]: [f64; 3]) -> Vec<[f64; 2]> {
    // The lower triangular root of the covariance turns a circle into the ellipse.
    let east_sigma = east.max(0.0).sqrt();
    let shared = if east_sigma > 0.0 {
        both / east_sigma
    } else {
        0.0
    };
    let rest = (north - shared * shared).max(0.0).sqrt();
    (0..ELLIPSE_POINTS)
        .map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / ELLIPSE_POINTS as f64;
            let (sin, cos) = angle.sin_cos();
            let east_m = SIGMAS_95 * east_sigma * cos;
            let north_m = SIGMAS_95 * (shared * cos + rest * sin);
            let bearing_deg = east_m.atan2(north_m).to_degrees();
            let point = destination(centre, bearing_deg, east_m.hypot(north_m));
            // On the same side of the antimeridian as the centre.
            let turns = ((point.lon_deg - centre.lon_deg) / 360.0).round();
            [point.lon_deg - 360.0 * turns, point.lat_deg]
        })
        .collect()
}

/// Edges of what was written.
#[derive(Clone, Copy, Debug, Default)]
struct Bounds(Option<[f64; 4]>);

impl Bounds {
    fn add(&mut self, [x, y]: [f64; 2]) {
        let [west, south, east, north] = self.0.unwrap_or([x, y, x, y]);
        self.0 = Some([west.min(x), south.min(y), east.max(x), north.max(y)]);
    }

    fn edges(self) -> [Option<f64>; 4] {
        self.0.map_or([None; 4], |edges| edges.map(Some))
    }
}

/// The header of a geometry (OGC 12-128r18, 2.1.3): little-endian, with an envelope of x and y or without.
fn header(envelope: Option<[f64; 4]>) -> Vec<u8> {
    let flags = if envelope.is_some() { 0b011 } else { 0b001 };
    let mut blob = vec![b'G', b'P', 0, flags];
    blob.extend(SRS_ID.to_le_bytes());
    for number in envelope.iter().flatten() {
        blob.extend(number.to_le_bytes());
    }
    blob
}

fn point_blob(point: [f64; 2]) -> Vec<u8> {
    let mut blob = header(None);
    blob.push(1);
    blob.extend(1_u32.to_le_bytes());
    blob.extend(point.iter().flat_map(|v| v.to_le_bytes()));
    blob
}

/// A polygon of one ring, which is closed here.
fn polygon_blob(ring: &[[f64; 2]], bounds: &mut Bounds) -> Vec<u8> {
    let mut own = Bounds::default();
    for &point in ring {
        own.add(point);
        bounds.add(point);
    }
    let mut blob = header(
        own.0
            .map(|[west, south, east, north]| [west, east, south, north]),
    );
    blob.push(1);
    blob.extend(3_u32.to_le_bytes());
    blob.extend(1_u32.to_le_bytes());
    let closed = ring.iter().chain(ring.first());
    blob.extend((closed.clone().count() as u32).to_le_bytes());
    blob.extend(closed.flatten().flat_map(|v| v.to_le_bytes()));
    blob
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_geo::offset_en_m;
    use std::io::Write;
    use std::process::Command;

    fn fix() -> Answer {
        Answer {
            photo: "flight/a & b.jpg".into(),
            state: State::Fix,
            lat_deg: Some(24.25),
            lon_deg: Some(120.75),
            radius95_m: Some(2.5),
            covariance_en_m2: Some([4.0, 1.2, 1.0]),
            inliers: Some(41),
            outline_lon_lat_deg: Some(vec![
                [120.5, 24.5],
                [121.0, 24.5],
                [121.0, 24.0],
                [120.5, 24.0],
            ]),
            ..Answer::default()
        }
    }

    #[test]
    fn an_ellipse_is_where_the_covariance_puts_it() {
        let centre = LonLat::new(179.999_99, -33.0);
        let [a, b, c] = [4.0, 1.2, 1.0];
        for [lon, lat] in ellipse(centre, [a, b, c]) {
            assert!(lon > 179.0, "{lon}");
            let (e, n) = offset_en_m(centre, LonLat::new(lon, lat));
            // Mahalanobis distance of the edge: the chi-square quantile of two degrees of freedom, 5.991.
            let squared = (c * e * e - 2.0 * b * e * n + a * n * n) / (a * c - b * b);
            assert!((squared - 5.991_464_5).abs() < 1e-3, "{squared}");
        }
    }

    #[test]
    fn gdal_reads_it() {
        let answers = [fix(), Answer::no_fix("c.jpg", "too few matches")];
        let bytes = geopackage_of(&answers).unwrap();
        let mut file = tempfile::Builder::new().suffix(".gpkg").tempfile().unwrap();
        file.write_all(&bytes).unwrap();
        let ogrinfo = |arguments: &[&str]| {
            Command::new("ogrinfo")
                .args(arguments)
                .arg(file.path())
                .output()
                .ok()
                .map(|output| {
                    let text = String::from_utf8_lossy(&output.stdout).into_owned();
                    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
                    assert!(output.status.success() && errors.is_empty(), "{errors}");
                    text
                })
        };
        let Some(text) = ogrinfo(&["-ro", "-al"]) else {
            let _ = writeln!(
                std::io::stderr(),
                "SKIPPED: GDAL's ogrinfo is not installed"
            );
            return;
        };
        for words in [
            "Layer name: fixes",
            "Layer name: outlines",
            "Layer name: ellipses95",
            "ID[\"EPSG\",4326]",
            "POINT (120.75 24.25)",
            "photo (String) = flight/a & b.jpg",
            "reason (String) = too few matches",
            "Extent: (120.500000, 24.000000) - (121.000000, 24.500000)",
        ] {
            assert!(text.contains(words), "{words} is not in\n{text}");
        }
        // GDAL's versions write numbers differently ("121" and "121.0").
        let polygons = text
            .lines()
            .filter_map(|line| line.trim().strip_prefix("POLYGON (("));
        let numbers = |line: &str| -> Vec<f64> {
            line.split([' ', ',', ')'])
                .filter_map(|number| number.parse().ok())
                .collect()
        };
        let outline = [
            120.5, 24.5, 121.0, 24.5, 121.0, 24.0, 120.5, 24.0, 120.5, 24.5,
        ];
        let is_outline = |found: &[f64]| {
            found.len() == outline.len()
                && found.iter().zip(outline).all(|(a, b)| (a - b).abs() < 1e-9)
        };
        assert!(
            polygons.map(numbers).any(|found| is_outline(&found)),
            "{text}"
        );
    }

    #[test]
    fn geometries_are_read_back() {
        let bytes = geopackage_of(&[fix()]).unwrap();
        assert_eq!(
            &bytes[68..72],
            b"GPKG",
            "application_id in the database header"
        );
        let point = point_blob([120.75, 24.25]);
        assert_eq!(point.len(), 8 + 5 + 16);
        assert_eq!(point[..8], [b'G', b'P', 0, 1, 0xE6, 0x10, 0, 0]);
        // No answers: layers without features.
        assert!(geopackage_of(&[]).is_ok());
    }
}
