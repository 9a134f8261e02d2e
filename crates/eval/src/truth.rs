//! Truth files: what the answer for each photo should have been.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The truth about one photo.
///
/// The image centre and the receiver's position are two different truths: a camera that looks a few
/// degrees ahead sees a centre some tens of metres in front of the drone.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthFrame {
    /// File name of the photo, without folders.
    pub photo: String,
    /// Where the image centre lies: latitude and longitude in degrees, WGS 84.
    pub centre_lat_lon_deg: Option<(f64, f64)>,
    /// Where the satellite receiver was: latitude and longitude in degrees, WGS 84.
    pub gps_lat_lon_deg: Option<(f64, f64)>,
    /// Direction of the photo's top edge, degrees clockwise from true north.
    pub heading_deg: Option<f64>,
    /// Height above ground in metres.
    pub height_agl_m: Option<f64>,
}

/// Why a truth file could not be used.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// The file could not be read.
    #[error("cannot read the truth file: {0}")]
    Io(#[from] std::io::Error),
    /// The file is not a table.
    #[error("{path}: not a comma-separated table: {source}")]
    Csv {
        /// The file.
        path: PathBuf,
        /// What the reader said.
        source: csv::Error,
    },
    /// A needed column is absent.
    #[error(
        "{path}: no column `photo` with `lat_deg`,`lon_deg` (or `centre_lat`,`centre_lon`, or `gps_lat`,`gps_lon`); its header is: {header}"
    )]
    Columns {
        /// The file.
        path: PathBuf,
        /// The header as read.
        header: String,
    },
    /// A value is not a usable number.
    #[error("{path}, line {line}: `{column}` is `{value}`, not a number in range")]
    Value {
        /// The file.
        path: PathBuf,
        /// Line in the file, from 1.
        line: u64,
        /// The column's name.
        column: String,
        /// The text found.
        value: String,
    },
}

/// Reads a truth file.
///
/// Columns, in any order: `photo`; `lat_deg`,`lon_deg` or `centre_lat`,`centre_lon` (image centre);
/// `gps_lat`,`gps_lon` (receiver); `heading_deg` or `flight_yaw_deg`; `height_agl_m`. Others are
/// ignored, empty cells mean "not known".
///
/// # Errors
/// Unreadable file, missing columns, a value that is no number or out of range: each names file, line
/// and column.
pub fn read(path: &Path) -> Result<Vec<TruthFrame>, TruthError> {
    let (frames, bad) = read_rows(path)?;
    bad.into_iter().next().map_or(Ok(frames), Err)
}

/// As [`read`], but a line with a bad value is left out and returned beside the good ones.
///
/// # Errors
/// Unreadable file, missing columns.
pub fn read_rows(path: &Path) -> Result<(Vec<TruthFrame>, Vec<TruthError>), TruthError> {
    let text = fs_err::read(path)?;
    let csv_error = |source| TruthError::Csv {
        path: path.to_owned(),
        source,
    };
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_slice());
    let header = reader.headers().map_err(csv_error)?.clone();
    let columns: HashMap<&str, usize> = header.iter().enumerate().map(|(i, h)| (h, i)).collect();
    let find = |names: &[&str]| names.iter().find_map(|n| columns.get(n).copied());
    let pair = |lat: &[&str], lon: &[&str]| find(lat).zip(find(lon));
    let centre = pair(&["lat_deg", "centre_lat"], &["lon_deg", "centre_lon"]);
    let gps = pair(&["gps_lat"], &["gps_lon"]);
    let (Some(photo), true) = (find(&["photo"]), centre.is_some() || gps.is_some()) else {
        return Err(TruthError::Columns {
            path: path.to_owned(),
            header: header.iter().collect::<Vec<_>>().join(","),
        });
    };
    let heading = find(&["heading_deg", "flight_yaw_deg"]);
    let height = find(&["height_agl_m"]);

    let (mut frames, mut bad) = (Vec::new(), Vec::new());
    for record in reader.records() {
        let record = record.map_err(csv_error)?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: Option<usize>, limit: f64| -> Result<Option<f64>, TruthError> {
            let Some(column) = column else {
                return Ok(None);
            };
            let text = record.get(column).unwrap_or("");
            if text.is_empty() {
                return Ok(None);
            }
            match text.parse::<f64>() {
                Ok(value) if value.abs() <= limit => Ok(Some(value)),
                _ => Err(TruthError::Value {
                    path: path.to_owned(),
                    line,
                    column: header.get(column).unwrap_or("").to_owned(),
                    value: text.to_owned(),
                }),
            }
        };
        let place = |columns: Option<(usize, usize)>| -> Result<Option<(f64, f64)>, TruthError> {
            let lat = number(columns.map(|c| c.0), 90.0)?;
            let lon = number(columns.map(|c| c.1), 180.0)?;
            Ok(lat.zip(lon))
        };
        let frame = || {
            Ok(TruthFrame {
                photo: record.get(photo).unwrap_or("").to_owned(),
                centre_lat_lon_deg: place(centre)?,
                gps_lat_lon_deg: place(gps)?,
                heading_deg: number(heading, 720.0)?,
                height_agl_m: number(height, 20_000.0)?,
            })
        };
        match frame() {
            Ok(frame) => frames.push(frame),
            Err(error) => bad.push(error),
        }
    }
    Ok((frames, bad))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<TruthFrame>, TruthError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("truth.csv");
        fs_err::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn reads_both_truths_by_either_name() {
        let frames = read_text(
            "photo,gps_lat,gps_lon,flight_yaw_deg,centre_lat,centre_lon\na.jpg,24.5,120.25,152.1,24.25,120.5\n",
        )
        .unwrap();
        assert_eq!(
            frames,
            vec![TruthFrame {
                photo: "a.jpg".into(),
                centre_lat_lon_deg: Some((24.25, 120.5)),
                gps_lat_lon_deg: Some((24.5, 120.25)),
                heading_deg: Some(152.1),
                height_agl_m: None,
            }]
        );
        let frames = read_text("photo,lat_deg,lon_deg,height_agl_m\nb.jpg,1,2,\n").unwrap();
        assert_eq!(frames[0].centre_lat_lon_deg, Some((1.0, 2.0)));
        assert_eq!(frames[0].height_agl_m, None);
    }

    #[test]
    fn names_the_line_and_column_of_a_bad_value() {
        let error = read_text("photo,lat_deg,lon_deg\na.jpg,NaN,2\n").unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("line 2") && text.contains("`lat_deg` is `NaN`"),
            "{text}"
        );
        assert!(read_text("photo,lat_deg,lon_deg\na.jpg,95,2\n").is_err());
    }

    #[test]
    fn good_lines_are_read_beside_bad_ones() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("truth.csv");
        fs_err::write(&path, "photo,lat_deg,lon_deg\na.jpg,NaN,2\nb.jpg,1,2\n").unwrap();
        let (frames, bad) = read_rows(&path).unwrap();
        assert_eq!(frames.len(), 1);
        assert!(bad[0].to_string().contains("line 2"), "{}", bad[0]);
    }

    #[test]
    fn asks_for_missing_columns() {
        let text = read_text("name,lat\nx,1\n").unwrap_err().to_string();
        assert!(
            text.contains("no column `photo`") && text.contains("name,lat"),
            "{text}"
        );
    }
}
