//! Truth files: the true position of each photo.

use std::path::{Path, PathBuf};

use grimnet_geo::LonLat;
use grimnet_photo::HEADING_RANGE_DEG;

/// The truth of one photo.
///
/// The image centre and the position of the receiver differ: a camera that looks a few degrees ahead
/// of straight down sees a centre some tens of metres in front of the drone.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TruthFrame {
    /// File name of the photo, or its path from the folder of photos.
    pub photo: String,
    /// Position of the image centre: latitude and longitude in degrees, WGS 84.
    pub centre_lat_lon_deg: Option<(f64, f64)>,
    /// Position of the satellite receiver: latitude and longitude in degrees, WGS 84.
    pub gps_lat_lon_deg: Option<(f64, f64)>,
    /// Direction of the photo's top edge, degrees clockwise from true north.
    pub heading_deg: Option<f64>,
    /// Height above ground in metres.
    pub height_agl_m: Option<f64>,
    /// Ground width that the photo shows, metres.
    pub footprint_width_m: Option<f64>,
    /// Angle between the camera's axis and straight down, degrees.
    pub tilt_deg: Option<f64>,
    /// Standard deviation of the true position, metres per axis.
    pub truth_error_m: Option<f64>,
    /// Share of the photo without features, 0 to 1, such as sea or mud: a photo with a large share cannot be localised.
    pub featureless_share: Option<f64>,
    /// Name of the place that the photo shows; photos of one place are not independent of each other.
    pub place: Option<String>,
}

impl TruthFrame {
    /// Position that an answer is compared with: the image centre, or the receiver if the centre is not known.
    #[must_use]
    pub fn position(&self) -> Option<LonLat> {
        self.centre_lat_lon_deg.or(self.gps_lat_lon_deg).map(lonlat)
    }

    /// Position of the satellite receiver, if it is known.
    #[must_use]
    pub fn receiver(&self) -> Option<LonLat> {
        self.gps_lat_lon_deg.map(lonlat)
    }
}

fn lonlat((lat_deg, lon_deg): (f64, f64)) -> LonLat {
    LonLat { lon_deg, lat_deg }
}

/// Why a truth file cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TruthError {
    /// The file could not be read.
    #[error("cannot read the truth file: {0}")]
    Io(#[from] std::io::Error),
    /// The file is not a table.
    #[error("{path}: not a comma-separated table: {source}")]
    Csv {
        /// The file.
        path: PathBuf,
        /// The reader's error.
        source: csv::Error,
    },
    /// The file is not text in UTF-8.
    #[error("{path}, line {line}: not UTF-8 text; save the table as UTF-8")]
    NotUtf8 {
        /// The file.
        path: PathBuf,
        /// Line in the file, from 1.
        line: u64,
    },
    /// Two columns of one name.
    #[error("{path}: two columns are named `{name}`; rename the one that is not meant")]
    ColumnTwice {
        /// The file.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// A required column is missing.
    #[error(
        "{path}: expected a comma-separated table with a column `photo` and the columns `lat_deg`,`lon_deg` (or `centre_lat`,`centre_lon`, or `gps_lat`,`gps_lon`); found: {header}"
    )]
    Columns {
        /// The file.
        path: PathBuf,
        /// The header as read.
        header: String,
    },
    /// A value is not a usable number.
    #[error("{path}, line {line}: `{column}` is `{value}`, expected a number {expected}")]
    Value {
        /// The file.
        path: PathBuf,
        /// Line in the file, from 1.
        line: u64,
        /// The column's name.
        column: String,
        /// The text found.
        value: String,
        /// The accepted range, or why there must be a value.
        expected: String,
    },
}

/// Reads a truth file.
///
/// Columns, in any order: `photo`; `lat_deg`,`lon_deg` or `centre_lat`,`centre_lon` (image centre);
/// `gps_lat`,`gps_lon` (receiver); optional: `heading_deg` or `flight_yaw_deg`; `height_agl_m`;
/// `footprint_w_m`; `tilt_deg`; `truth_err_m`; `flat_frac` (share without features); `place`. Other
/// columns are ignored; an empty cell means that the value is not known.
///
/// # Errors
/// Unreadable file, missing columns, a value that is not a number or out of range: each names file,
/// line and column.
pub fn read(path: &Path) -> Result<Vec<TruthFrame>, TruthError> {
    let (frames, bad) = read_rows(path)?;
    bad.into_iter().next().map_or(Ok(frames), Err)
}

/// As [`read`], but lines with a bad value are returned beside the good ones instead of failing.
///
/// # Errors
/// Unreadable file, missing columns.
pub fn read_rows(path: &Path) -> Result<(Vec<TruthFrame>, Vec<TruthError>), TruthError> {
    let text = fs_err::read(path)?;
    let csv_error = |source: csv::Error| {
        let path = path.to_owned();
        if matches!(source.kind(), csv::ErrorKind::Utf8 { .. }) {
            let line = source.position().map_or(1, csv::Position::line);
            TruthError::NotUtf8 { path, line }
        } else {
            TruthError::Csv { path, source }
        }
    };
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_slice());
    let header = reader.headers().map_err(csv_error)?.clone();
    let columns = Columns::find(path, header)?;
    let (mut frames, mut bad) = (Vec::new(), Vec::new());
    for record in reader.records() {
        let record = record.map_err(csv_error)?;
        match columns.frame(path, &record) {
            Ok(frame) => frames.push(frame),
            Err(error) => bad.push(error),
        }
    }
    Ok((frames, bad))
}

/// All columns that are read.
const COLUMNS: [&str; 15] = [
    "photo",
    "lat_deg",
    "lon_deg",
    "centre_lat",
    "centre_lon",
    "gps_lat",
    "gps_lon",
    "heading_deg",
    "flight_yaw_deg",
    "height_agl_m",
    "footprint_w_m",
    "tilt_deg",
    "truth_err_m",
    "flat_frac",
    "place",
];

/// Where each column of a truth file is.
struct Columns {
    header: csv::StringRecord,
    photo: usize,
    centre: Option<(usize, usize)>,
    gps: Option<(usize, usize)>,
    place: Option<usize>,
}

impl Columns {
    fn find(path: &Path, header: csv::StringRecord) -> Result<Self, TruthError> {
        let find = |names: &[&str]| position(&header, names);
        for name in COLUMNS {
            if header.iter().filter(|column| *column == name).count() > 1 {
                return Err(TruthError::ColumnTwice {
                    path: path.to_owned(),
                    name: name.to_owned(),
                });
            }
        }
        // A latitude by one name and a longitude by another may be of two positions.
        let pair = |lat: &str, lon: &str| find(&[lat]).zip(find(&[lon]));
        let centre = pair("lat_deg", "lon_deg").or_else(|| pair("centre_lat", "centre_lon"));
        let gps = pair("gps_lat", "gps_lon");
        match find(&["photo"]) {
            Some(photo) if centre.is_some() || gps.is_some() => Ok(Self {
                photo,
                centre,
                gps,
                place: find(&["place"]),
                header,
            }),
            _ => Err(TruthError::Columns {
                path: path.to_owned(),
                header: header.iter().collect::<Vec<_>>().join(","),
            }),
        }
    }

    fn frame(&self, path: &Path, record: &csv::StringRecord) -> Result<TruthFrame, TruthError> {
        let number = |column: Option<usize>, low: f64, high: f64| {
            self.number(path, record, column, (low, high))
        };
        let named = |names: &[&str], low, high| number(position(&self.header, names), low, high);
        let point = |columns: Option<(usize, usize)>| -> Result<Option<(f64, f64)>, TruthError> {
            let Some((lat_column, lon_column)) = columns else {
                return Ok(None);
            };
            let lat = number(Some(lat_column), -90.0, 90.0)?;
            let lon = number(Some(lon_column), -180.0, 180.0)?;
            let missing = match (lat, lon) {
                (Some(_), None) => lon_column,
                (None, Some(_)) => lat_column,
                _ => return Ok(lat.zip(lon)),
            };
            // Half a position is a slip, and no reason to take another one.
            let expected = "because the other coordinate is given".to_owned();
            Err(self.wrong_value(path, record, missing, expected))
        };
        let text = |column: usize| record.get(column).unwrap_or("").to_owned();
        let (lowest_deg, highest_deg) = HEADING_RANGE_DEG.into_inner();
        Ok(TruthFrame {
            photo: text(self.photo),
            centre_lat_lon_deg: point(self.centre)?,
            gps_lat_lon_deg: point(self.gps)?,
            heading_deg: named(&["heading_deg", "flight_yaw_deg"], lowest_deg, highest_deg)?,
            height_agl_m: named(&["height_agl_m"], -20_000.0, 20_000.0)?,
            footprint_width_m: named(&["footprint_w_m"], 0.1, 1e6)?,
            tilt_deg: named(&["tilt_deg"], 0.0, 180.0)?,
            truth_error_m: named(&["truth_err_m"], 0.0, 1e6)?,
            featureless_share: named(&["flat_frac"], 0.0, 1.0)?,
            place: self.place.map(text).filter(|place| !place.is_empty()),
        })
    }

    /// A number from `low` to `high`; `None` for an absent column or an empty cell.
    fn number(
        &self,
        path: &Path,
        record: &csv::StringRecord,
        column: Option<usize>,
        (low, high): (f64, f64),
    ) -> Result<Option<f64>, TruthError> {
        let Some((column, text)) = column.and_then(|c| Some((c, record.get(c)?))) else {
            return Ok(None);
        };
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if (low..=high).contains(&value) => Ok(Some(value)),
            _ => Err(self.wrong_value(path, record, column, format!("from {low} to {high}"))),
        }
    }

    fn wrong_value(
        &self,
        path: &Path,
        record: &csv::StringRecord,
        column: usize,
        expected: String,
    ) -> TruthError {
        TruthError::Value {
            path: path.to_owned(),
            line: record.position().map_or(0, csv::Position::line),
            column: self.header.get(column).unwrap_or("").to_owned(),
            value: record.get(column).unwrap_or("").to_owned(),
            expected,
        }
    }
}

/// The first column that has one of these names.
fn position(header: &csv::StringRecord, names: &[&str]) -> Option<usize> {
    names
        .iter()
        .find_map(|name| header.iter().position(|column| column == *name))
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
                ..TruthFrame::default()
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
    fn half_a_position_is_a_bad_value_and_not_replaced_by_the_receivers() {
        let header = "photo,centre_lat,centre_lon,gps_lat,gps_lon";
        for (row, column) in [
            ("a.jpg,24.5,,24.6,120.1", "`centre_lon` is ``"),
            ("a.jpg,,120.2,24.6,120.1", "`centre_lat` is ``"),
            ("a.jpg,24.5,120.2,24.6,", "`gps_lon` is ``"),
        ] {
            let error = read_text(&format!("{header}\n{row}\n")).unwrap_err();
            let expected = format!("{column}, expected a number because the other coordinate");
            assert!(error.to_string().contains(&expected), "{error}");
        }
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
    fn what_is_known_of_the_view_and_the_place_is_read() {
        let header = "photo,centre_lat,centre_lon,place,heading_deg,tilt_deg,footprint_w_m,truth_err_m,flat_frac";
        let frame = read_text(&format!(
            "{header}\na.jpg,1,2,OO4,177.7,5.6,204.3,1.5,0.20\n"
        ))
        .unwrap()
        .remove(0);
        assert_eq!(frame.place.as_deref(), Some("OO4"));
        assert_eq!(frame.footprint_width_m, Some(204.3));
        assert_eq!(
            (frame.tilt_deg, frame.truth_error_m),
            (Some(5.6), Some(1.5))
        );
        assert_eq!(frame.featureless_share, Some(0.2));
        for bad in ["a.jpg,1,2,OO4,1,1,-5,1,0", "a.jpg,1,2,OO4,1,1,100,1,1.5"] {
            assert!(read_text(&format!("{header}\n{bad}\n")).is_err(), "{bad}");
        }
    }

    #[test]
    fn two_columns_of_one_name_are_refused_where_they_are_read() {
        let text = read_text("photo,note,note,lat_deg,lon_deg,lat_deg\n")
            .unwrap_err()
            .to_string();
        assert!(text.contains("two columns are named `lat_deg`"), "{text}");
        assert!(read_text("photo,note,note,lat_deg,lon_deg\n").is_ok());
    }

    #[test]
    fn a_position_is_of_one_pair_of_columns() {
        let frames =
            read_text("photo,lat_deg,centre_lat,centre_lon\na.jpg,1,24.25,120.5\n").unwrap();
        assert_eq!(frames[0].centre_lat_lon_deg, Some((24.25, 120.5)));
    }

    #[test]
    fn a_table_in_another_encoding_is_told_to_be_in_utf_8() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("truth.csv");
        for (bytes, line) in [
            (
                &b"photo,lat_deg,lon_deg,place\na.jpg,1,2,Z\xfcrich\n"[..],
                2,
            ),
            (&b"\xff\xfep\0h\0o\0t\0o\0"[..], 1),
        ] {
            fs_err::write(&path, bytes).unwrap();
            let text = read(&path).unwrap_err().to_string();
            let expected = format!("line {line}: not UTF-8 text");
            assert!(text.contains(&expected), "{text}");
        }
    }

    #[test]
    fn asks_for_missing_columns() {
        for header in [
            "name,lat",
            "photo;lat_deg;lon_deg",
            "photo,lat_deg,centre_lon",
        ] {
            let error = read_text(&format!("{header}\n")).unwrap_err();
            let text = error.to_string();
            assert!(
                text.contains("a comma-separated table with a column `photo`")
                    && text.contains(header),
                "{text}"
            );
        }
    }
}
