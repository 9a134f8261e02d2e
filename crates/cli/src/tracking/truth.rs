//! How far a track is from the truth.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

use anyhow::{Result, bail};
use grimnet_answer::printable;
use grimnet_eval::datasets::truth::{self, TruthFrame};
use grimnet_geo::{LonLat, offset_en_m};
use grimnet_locate::{Localizer, Near};
use grimnet_track::measure::{Answer, Instant, Measure, TrackSummary};
use grimnet_track::{PositionOf, TrackPoint};

use super::line::TrackLine;

/// A true position within this distance of a tile is plausible, metres.
const NEAR_THE_MAP_M: f64 = 10_000.0;
/// So many true positions are compared with the map.
const MOST_COMPARED: usize = 100;

/// True positions by photo.
pub struct Truth {
    path: PathBuf,
    /// The rows, one at least.
    frames: Vec<TruthFrame>,
    /// Numbers of the rows whose photo has this file name, in their order.
    of_name: HashMap<OsString, Vec<usize>>,
}

/// The comparison of one frame.
#[derive(Debug, Clone, Copy)]
pub struct Compared {
    /// Where it was.
    pub truth: LonLat,
    /// With what was answered.
    pub instant: Instant,
}

impl Truth {
    /// Reads a table with a column `photo`, and the aircraft's position (`gps_lat`, `gps_lon`) or that of the image centre
    /// (`lat_deg`, `lon_deg`).
    ///
    /// # Errors
    /// The table cannot be read or holds nothing.
    pub fn read(path: &Path) -> Result<Self> {
        crate::inputs::check_regular(path)?;
        let frames = truth::read(path)?;
        if frames.is_empty() {
            bail!("{}: holds no true position", path.display());
        }
        let mut of_name: HashMap<OsString, Vec<usize>> = HashMap::new();
        for (row, frame) in frames.iter().enumerate() {
            if let Some(name) = Path::new(&frame.photo).file_name() {
                of_name.entry(name.to_owned()).or_default().push(row);
            }
        }
        Ok(Self {
            path: path.to_owned(),
            frames,
            of_name,
        })
    }

    /// Warns if no true position is near the map of the pack: columns that are exchanged, or another flight.
    ///
    /// # Errors
    /// The pack has no coordinates.
    pub fn warn_if_off_the_map(&self, localizer: &Localizer) -> Result<()> {
        let place = |frame: &TruthFrame| {
            let known = frame.gps_lat_lon_deg.or(frame.centre_lat_lon_deg);
            known.map(|(lat_deg, lon_deg)| LonLat::new(lon_deg, lat_deg))
        };
        let radius_m = NEAR_THE_MAP_M;
        for centre in self.frames.iter().filter_map(place).take(MOST_COMPARED) {
            if localizer.has_tiles_near(&Near { centre, radius_m })? {
                return Ok(());
            }
        }
        if let Some(LonLat { lon_deg, lat_deg }) = self.frames.first().and_then(place) {
            tracing::warn!(
                "{}: its true positions are not within {:.0} km of the map of {} (the first: latitude {lat_deg}, longitude {lon_deg}); \
                 check its columns of latitude and longitude",
                printable(&self.path.display().to_string()),
                radius_m / 1000.0,
                printable(&localizer.pack().path().display().to_string())
            );
        }
        Ok(())
    }

    /// The first row of a photo: its path ends with what the row names, a file name or a path.
    fn frame(&self, photo: &str) -> Option<&TruthFrame> {
        let photo = Path::new(photo);
        let rows = self.of_name.get(photo.file_name()?)?;
        let mut frames = rows.iter().map(|&row| &self.frames[row]);
        frames.find(|frame| photo.ends_with(plain_path(&frame.photo)))
    }

    /// Whether it says something of a photo.
    pub fn names(&self, photo: &str) -> bool {
        self.frame(photo).is_some()
    }

    /// What is said where it names none of so many frames.
    pub fn names_none_text(&self, frames: usize) -> String {
        let (path, first) = (self.path.display().to_string(), self.frames.first());
        format!(
            "{} names none of the {frames} frames, so that the track is compared with nothing (the first photo that it names: {})",
            printable(&path),
            printable(first.map_or("", |frame| &frame.photo))
        )
    }

    /// Compares the track at a frame; `None` if the truth of that photo is not known, or not of the point that the track tells: an
    /// image centre is compared with true centres only.
    pub fn compare(
        &self,
        photo: &str,
        time_s: f64,
        point: Option<&TrackPoint>,
    ) -> Option<Compared> {
        let estimate = point.and_then(|point| point.estimate.as_ref());
        let truth = self.of(photo, estimate.map(|estimate| estimate.position_of))?;
        Some(Compared {
            truth,
            instant: Instant::of(point, time_s, truth),
        })
    }

    /// The same of a smoothed track, which has no line for a frame where it has no position.
    pub fn compare_smoothed(
        &self,
        photo: &str,
        time_s: f64,
        line: Option<&TrackLine>,
    ) -> Option<Compared> {
        let truth = self.of(photo, line.and_then(|line| line.position_of))?;
        let answer = line.and_then(|line| {
            let [lon_deg, lat_deg] = line.lon_lat_deg()?;
            let (east_m, north_m) = offset_en_m(truth, LonLat::new(lon_deg, lat_deg));
            Some(Answer {
                error_en_m: [east_m, north_m],
                covariance_en_m2: line.covariance_en_m2?,
                radius95_m: line.radius95_m?,
            })
        });
        Some(Compared {
            truth,
            instant: Instant { time_s, answer },
        })
    }

    /// The true position of the point of a photo that the track is of.
    fn of(&self, photo: &str, position_of: Option<PositionOf>) -> Option<LonLat> {
        let frame = self.frame(photo)?;
        if position_of == Some(PositionOf::ImageCentre) {
            frame
                .centre_lat_lon_deg
                .map(|(lat_deg, lon_deg)| LonLat::new(lon_deg, lat_deg))
        } else {
            frame.receiver().or_else(|| frame.position())
        }
    }
}

/// A path without parts that lead nowhere, as in `./a.jpg`.
fn plain_path(path: &str) -> PathBuf {
    let parts = Path::new(path).components();
    parts.filter(|part| *part != Component::CurDir).collect()
}

/// Figures over a flight.
pub fn summary(compared: &[Compared]) -> TrackSummary {
    let mut measure = Measure::default();
    let instants: Vec<Instant> = compared.iter().map(|compared| compared.instant).collect();
    measure.add_flight(&instants);
    measure.summary()
}

#[cfg(test)]
pub(super) mod tests {
    use grimnet_track::{Input, PositionFix, TrackOptions, Tracker};

    use super::super::frame_time::Epoch;
    use super::*;

    /// The track of a camera that is found at one place at these times, seconds.
    pub(in crate::tracking) fn hovering(times_s: impl IntoIterator<Item = f64>) -> Tracker {
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        for time_s in times_s {
            let fix = PositionFix {
                time_s,
                lonlat: LonLat::new(120.5, 24.25),
                covariance_en_m2: [1.0, 0.0, 1.0],
                map_error_m: 1.0,
                heading_deg: Some(0.0),
                gsd_m: 0.05,
                confidence: 0.99,
            };
            tracker.push(Input::Fix(fix)).unwrap();
        }
        tracker
    }

    #[test]
    fn an_image_centre_is_not_compared_with_the_position_of_the_aircraft() {
        let tracker = hovering([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let point = tracker.point_at(7.0).unwrap();
        assert_eq!(
            point.estimate.unwrap().position_of,
            PositionOf::ImageCentre,
            "neither height nor attitude is known"
        );
        let folder = tempfile::tempdir().unwrap();
        let compared = |columns: &str, values: &str| {
            let path = folder.path().join("truth.csv");
            fs_err::write(&path, format!("photo,{columns}\na.jpg,{values}\n")).unwrap();
            let truth = Truth::read(&path).unwrap();
            truth.compare("flight/a.jpg", 7.0, Some(&point))
        };
        assert!(compared("gps_lat,gps_lon", "24.2502,120.5").is_none());
        let of_both = compared(
            "gps_lat,gps_lon,centre_lat,centre_lon",
            "24.2502,120.5,24.25,120.5",
        );
        let answer = of_both.unwrap().instant.answer.unwrap();
        assert!(answer.error_m() < 0.5, "{answer:?}");
    }

    #[test]
    fn a_smoothed_position_is_compared_and_a_frame_without_one_is_no_answer() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.csv");
        fs_err::write(&path, "photo,gps_lat,gps_lon\na.jpg,24.25,120.5\n").unwrap();
        let truth = Truth::read(&path).unwrap();
        let line = TrackLine {
            lat_deg: Some(24.2502),
            lon_deg: Some(120.5),
            radius95_m: Some(3.0),
            covariance_en_m2: Some([1.0, 0.0, 1.0]),
            position_of: Some(PositionOf::Aircraft),
            ..TrackLine::new(7.0, Epoch::Start, None, None)
        };
        let compared = |line| truth.compare_smoothed("flight/a.jpg", 7.0, line);
        let answer = compared(Some(&line)).unwrap().instant.answer.unwrap();
        assert!((answer.error_m() - 22.15).abs() < 0.1, "{answer:?}");
        assert!(compared(None).unwrap().instant.answer.is_none());
    }

    #[test]
    fn a_photo_is_found_by_its_path_and_its_first_row_counts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.csv");
        let rows = "100/a.jpg,1,120\n101/a.jpg,2,120\n./b.jpg,3,120\nb.jpg,4,120\n";
        fs_err::write(&path, format!("photo,lat_deg,lon_deg\n{rows}")).unwrap();
        let truth = Truth::read(&path).unwrap();
        let lat_deg = |photo: &str| truth.of(photo, None).map(|position| position.lat_deg);
        assert_eq!(lat_deg("flight/100/a.jpg"), Some(1.0));
        assert_eq!(lat_deg("flight/101/a.jpg"), Some(2.0));
        assert_eq!(lat_deg("flight/102/a.jpg"), None);
        assert_eq!(lat_deg("flight/b.jpg"), Some(3.0));
        assert_eq!(lat_deg("b.jpg"), Some(3.0));
    }

    #[test]
    fn a_file_of_another_flight_names_none_of_the_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.csv");
        fs_err::write(&path, "photo,gps_lat,gps_lon\nDJI_0001.JPG,24.25,120.5\n").unwrap();
        let truth = Truth::read(&path).unwrap();
        assert!(truth.names("flight/DJI_0001.JPG"));
        assert!(!truth.names("flight/a.jpg"));
        let text = truth.names_none_text(30);
        assert!(
            text.contains("none of the 30 frames") && text.contains("DJI_0001.JPG"),
            "{text}"
        );
    }
}
