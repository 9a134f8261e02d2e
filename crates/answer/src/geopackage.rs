//! Answers as a GeoPackage, for QGIS and GDAL: fixes as points, outlines and 95 % ellipses as polygons.

use crate::answer::{Answer, State};
use crate::error::Result;
use crate::geopackage_file::{GeoPackage, Layer};
use crate::geopackage_geometry::Geometry;

const FIXES: usize = 0;
const OUTLINES: usize = 1;
const ELLIPSES: usize = 2;

static LAYERS: [Layer; 3] = [
    Layer {
        name: "fixes",
        geometry: "POINT",
        description: "image centre of each photo; photos without a fix have no geometry",
        columns: &[
            ("photo", "TEXT"),
            ("state", "TEXT"),
            ("heading_deg", "DOUBLE"),
            ("gsd_m", "DOUBLE"),
            ("radius95_m", "DOUBLE"),
            ("variance_east_m2", "DOUBLE"),
            ("covariance_east_north_m2", "DOUBLE"),
            ("variance_north_m2", "DOUBLE"),
            ("confidence", "DOUBLE"),
            ("inliers", "INTEGER"),
            ("reason", "TEXT"),
            ("check_m", "DOUBLE"),
        ],
    },
    Layer {
        name: "outlines",
        geometry: "POLYGON",
        description: "outline of each photo on the ground",
        columns: &[("photo", "TEXT")],
    },
    Layer {
        name: "ellipses95",
        geometry: "POLYGON",
        description: "ellipse of each fix that should hold the truth in 95 % of cases",
        columns: &[("photo", "TEXT"), ("radius95_m", "DOUBLE")],
    },
];

/// All answers as the bytes of a GeoPackage with the layers `fixes`, `outlines` and `ellipses95`, in EPSG:4326.
///
/// # Errors
/// Returns [`crate::AnswerError::Database`] if SQLite fails, which takes a lack of memory.
pub fn geopackage_of<'a>(answers: impl IntoIterator<Item = &'a Answer>) -> Result<Vec<u8>> {
    let mut file = GeoPackage::new(&LAYERS)?;
    for answer in answers {
        add(&mut file, answer)?;
    }
    file.finish()
}

fn add(file: &mut GeoPackage, answer: &Answer) -> Result<()> {
    let position = answer
        .lon_deg
        .zip(answer.lat_deg)
        .filter(|_| answer.state == State::Fix)
        .map(|(lon, lat)| [lon, lat]);
    let covariance = answer.covariance_en_m2;
    let state = match answer.state {
        State::Fix => "fix",
        State::NoFix => "no_fix",
    };
    let point = position.map(Geometry::Point);
    file.add(
        FIXES,
        point.as_ref(),
        &[
            &answer.photo,
            &state,
            &answer.heading_deg,
            &answer.gsd_m,
            &answer.radius95_m,
            &covariance.map(|c| c[0]),
            &covariance.map(|c| c[1]),
            &covariance.map(|c| c[2]),
            &answer.confidence,
            &answer.inliers.map(|n| n as i64),
            &answer.reason,
            &answer.check_m,
        ],
    )?;
    if let Some(outline) = answer.outline_ring() {
        let polygon = Geometry::Polygon(outline);
        file.add(OUTLINES, Some(&polygon), &[&answer.photo])?;
    }
    if let (Some(position), Some(covariance)) = (position, covariance) {
        let ellipse = Geometry::ellipse95(position, covariance);
        let values: [&dyn rusqlite::ToSql; 2] = [&answer.photo, &answer.radius95_m];
        file.add(ELLIPSES, Some(&ellipse), &values)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
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
            check_m: Some(3.25),
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
            "check_m (Real) = 3.25",
            "check_m (Real) = (null)",
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
            120.5, 24.5, 120.5, 24.0, 121.0, 24.0, 121.0, 24.5, 120.5, 24.5,
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
    fn an_outline_stays_on_the_side_of_its_fix() {
        let answer = Answer {
            lon_deg: Some(179.9999),
            outline_lon_lat_deg: Some(vec![
                [179.9995, 24.5],
                [-179.9995, 24.5],
                [-179.9995, 24.0],
                [179.9995, 24.0],
            ]),
            ..fix()
        };
        let bytes = geopackage_of(&[answer]).unwrap();
        let mut base = rusqlite::Connection::open_in_memory().unwrap();
        base.deserialize_read_exact("main", &bytes[..], bytes.len(), true)
            .unwrap();
        let [west, east] = ["min_x", "max_x"].map(|edge| -> f64 {
            let sql = format!("SELECT {edge} FROM gpkg_contents WHERE table_name = 'outlines'");
            base.query_row(&sql, [], |row| row.get(0)).unwrap()
        });
        assert!((west - 179.9995).abs() < 1e-9 && (east - 180.0005).abs() < 1e-9);
    }

    #[test]
    fn the_file_says_that_it_is_a_geopackage() {
        let bytes = geopackage_of(&[fix()]).unwrap();
        assert_eq!(
            &bytes[68..72],
            b"GPKG",
            "application_id in the database header"
        );
        // No answers: layers without features.
        assert!(geopackage_of(&[]).is_ok());
    }
}
