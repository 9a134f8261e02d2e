//! Reads scenes of UAV-VisLoc (Xu et al. 2024, arXiv 2405.11936) in their published layout.
//!
//! `UAV-VisLoc/03/` holds `drone/*.JPG`, `satellite03.tif` and `03.csv`; the corners of all maps are in
//! `satellite_coordinates_range.csv` in the parent folder (some copies have a space before `coordinates`), with the columns
//! `mapname` (`satellite03.tif`, or `03.tif` as in the publishers' example), `LT_lat_map`, `LT_lon_map`, `RB_lat_map`,
//! `RB_lon_map`. `03.csv` gives the position of each photo's centre (`filename`, `lat`, `lon`) and the aircraft's heading
//! (`Phi1`), which scene 07 lacks. Its heights are above sea level and are not used. The map of scene 09 is in four parts,
//! `satellite09_01-01.tif` and so on, which are joined.

mod map_parts;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use grimnet_photo::HEADING_RANGE_DEG;

use crate::datasets::truth::TruthFrame;

/// A scene as read from its folder.
#[derive(Debug, Clone, PartialEq)]
pub struct VislocScene {
    /// The map.
    pub map: PathBuf,
    /// Its corners, degrees: `[LL_LON, LL_LAT, UR_LON, UR_LAT]`.
    pub corners: [f64; 4],
    /// Folder of the photos.
    pub photos: PathBuf,
    /// Their truths.
    pub frames: Vec<TruthFrame>,
    /// The tables that corners and truths were read from.
    pub tables: Vec<PathBuf>,
    /// Messages about lines that were skipped, each with the reason.
    pub left_out: Vec<String>,
}

/// Why a scene cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VislocError {
    /// A file cannot be read.
    #[error("{path}: {source}")]
    Csv {
        /// The file.
        path: PathBuf,
        /// The reader's error.
        source: csv::Error,
    },
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The parts of the map cannot be joined.
    #[error("{folder}: the map is in parts that cannot be joined: {reason}")]
    Parts {
        /// The scene.
        folder: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The table of corners is missing.
    #[error("{folder}: no satellite_coordinates_range.csv, which gives the corners of the maps")]
    NoCorners {
        /// The folder that was searched.
        folder: PathBuf,
    },
    /// The table of corners has no usable line for the map.
    #[error(
        "{path}: no line for {map} with LT_lat_map, LT_lon_map, RB_lat_map and RB_lon_map in degrees"
    )]
    CornersOf {
        /// The table.
        path: PathBuf,
        /// The map's file name.
        map: String,
    },
}

/// Returns whether a folder has the files of a scene.
#[must_use]
pub fn is_scene(folder: &Path) -> bool {
    name_of(folder).is_some_and(|name| {
        folder.join(format!("{name}.csv")).is_file()
            && (folder.join(format!("satellite{name}.tif")).is_file()
                || map_parts::has_parts(folder, &name))
    })
}

fn name_of(folder: &Path) -> Option<String> {
    let folder = fs_err::canonicalize(folder).ok()?;
    Some(folder.file_name()?.to_str()?.to_owned())
}

/// Reads the scene in `folder`. If its map is in parts, a file that joins them is written into the folder `scratch`.
///
/// # Errors
/// Returns an error if a table is missing or unreadable, or has no corners for the map, or its parts cannot be joined.
pub fn read(folder: &Path, scratch: &Path) -> Result<VislocScene, VislocError> {
    let name = name_of(folder).unwrap_or_default();
    let map_name = format!("satellite{name}.tif");
    let above = folder.join("..");
    let tables = [
        "satellite_coordinates_range.csv",
        "satellite_ coordinates_range.csv",
    ];
    let table = tables
        .iter()
        .map(|table| above.join(table))
        .find(|path| path.is_file())
        .ok_or_else(|| VislocError::NoCorners {
            folder: above.clone(),
        })?;
    let rows = rows(&table)?;
    let names = [map_name.clone(), format!("{name}.tif")];
    let corners = names
        .iter()
        .find_map(|name| rows.iter().find(|row| row.get("mapname") == Some(name)))
        .and_then(|row| {
            let number = |column: &str| row.get(column)?.parse::<f64>().ok();
            let (top, left) = (number("LT_lat_map")?, number("LT_lon_map")?);
            let (bottom, right) = (number("RB_lat_map")?, number("RB_lon_map")?);
            Some([left, bottom, right, top])
        })
        .filter(|corners| corners.iter().all(|v| v.is_finite()))
        .ok_or(VislocError::CornersOf {
            path: table.clone(),
            map: map_name.clone(),
        })?;
    let path = folder.join(format!("{name}.csv"));
    let (mut frames, mut left_out) = (Vec::new(), Vec::new());
    for (line, row) in (2..).zip(self::rows(&path)?) {
        match frame(&row) {
            Some(frame) => frames.push(frame),
            None => left_out.push(format!(
                "{}, line {line}: no `filename` with `lat` and `lon` in degrees; skipped",
                path.display()
            )),
        }
    }
    let map = folder.join(map_name);
    Ok(VislocScene {
        map: if map.is_file() {
            map
        } else {
            map_parts::join(folder, &name, scratch)?
        },
        corners,
        photos: folder.join("drone"),
        frames,
        tables: vec![table, path],
        left_out,
    })
}

fn frame(row: &HashMap<String, String>) -> Option<TruthFrame> {
    let number = |column: &str, limit: f64| {
        let value = row.get(column)?.parse::<f64>().ok()?;
        (value.abs() <= limit).then_some(value)
    };
    Some(TruthFrame {
        photo: row.get("filename").filter(|name| !name.is_empty())?.clone(),
        centre_lat_lon_deg: Some((number("lat", 90.0)?, number("lon", 180.0)?)),
        heading_deg: number("Phi1", *HEADING_RANGE_DEG.end()),
        ..TruthFrame::default()
    })
}

/// The rows of a table, each by column name.
fn rows(path: &Path) -> Result<Vec<HashMap<String, String>>, VislocError> {
    let error = |source| VislocError::Csv {
        path: path.to_owned(),
        source,
    };
    csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(error)?
        .deserialize()
        .collect::<Result<_, _>>()
        .map_err(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_read_as_it_is_published() {
        let root = tempfile::tempdir().unwrap();
        let scene = root.path().join("03");
        fs_err::create_dir_all(scene.join("drone")).unwrap();
        fs_err::write(scene.join("satellite03.tif"), b"").unwrap();
        let csv = "num,filename,date,lat,lon,height,Omega,Kappa,Phi1,Phi2\n\
                   1,03_0001.JPG,2018-10-21,32.30,119.90,466.3,0.1,0.2,-170.5,9.5\n\
                   2,03_0002.JPG,2018-10-21,NaN,119.90,466.3,0.1,0.2,-170.5,9.5\n";
        fs_err::write(scene.join("03.csv"), csv).unwrap();
        assert!(is_scene(&scene) && !is_scene(root.path()));
        assert!(matches!(
            read(&scene, root.path()),
            Err(VislocError::NoCorners { .. })
        ));
        let table = root.path().join("satellite_ coordinates_range.csv");
        let header = "mapname,LT_lat_map,LT_lon_map,RB_lat_map,RB_lon_map,region\n";
        fs_err::write(&table, header).unwrap();
        let text = read(&scene, root.path()).unwrap_err().to_string();
        assert!(text.contains("no line for satellite03.tif"), "{text}");
        let line = "satellite03.tif,32.355,119.805,32.251,119.955,Taizhou\n";
        fs_err::write(&table, format!("{header}{line}")).unwrap();
        let found = read(&scene, root.path()).unwrap();
        assert_eq!(found.corners, [119.805, 32.251, 119.955, 32.355]);
        assert_eq!(found.frames.len(), 1);
        assert_eq!(found.frames[0].centre_lat_lon_deg, Some((32.30, 119.90)));
        assert_eq!(found.frames[0].heading_deg, Some(-170.5));
        assert!(found.left_out[0].contains("line 3"), "{:?}", found.left_out);
        // As the example archive names the map.
        let example = line.replace("satellite03", "03");
        fs_err::write(&table, format!("{header}{example}")).unwrap();
        let found = read(&scene, root.path()).unwrap();
        assert_eq!(found.corners, [119.805, 32.251, 119.955, 32.355]);
    }
}
