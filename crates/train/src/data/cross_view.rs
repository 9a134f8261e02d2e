//! Pairs of an aircraft picture and the map picture that shows the same place, as VTRN's `gt_matches.csv` names them.
//!
//! They train retrieval only: the matches do not give corresponding points.

use super::cell_labels::LABEL_NONE;
use super::layout::{Fold, Folder, layout_error};
use super::mapping::Mapping;
use super::pair::{Pair, PairOptions, Place, Source};
use super::picture_file;
use crate::error::TrainError;
use grimnet_limits::PhotoLimits;
use image::RgbImage;
use image::imageops::{FilterType, resize};
use nalgebra::Matrix3;
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Side of the area that a map picture shows, metres: 500 pixels at about 1 m (paper, section 4.1.1).
const MAP_PICTURE_M: f64 = 500.0;
/// Picture indices of data folders stay below this number.
const FIRST_CROSS_VIEW: usize = 1 << 41;
/// Two pairs of a group whose map pictures share more than this of their area are not taken together.
const MOST_OVERLAP: f64 = 0.05;
/// Random choices for one pair before the group stays smaller.
const ATTEMPTS: usize = 20;

/// A row of `gt_matches.csv`; its other columns are not needed.
#[derive(Deserialize)]
struct MatchRow {
    query_name: String,
    ref_name: String,
}

/// A row of `reference.csv`.
#[derive(Deserialize)]
struct ReferenceRow {
    easting: f64,
    northing: f64,
    name: String,
}

#[derive(Debug)]
struct Match {
    photo: PathBuf,
    map: PathBuf,
    place: Place,
}

/// The matched pictures of one part of a VTRN folder.
#[derive(Debug)]
pub struct CrossView {
    matches: Vec<Match>,
    unreadable: usize,
    limits: PhotoLimits,
}

impl CrossView {
    /// Reads the matches of a fold (`Train` or `Val`) of a folder. `folder_index` tells data folders apart, whose coordinates
    /// are not related. Matches without their picture files, or with one beyond the limits, are skipped and counted.
    ///
    /// # Errors
    /// [`TrainError::Layout`] if `gt_matches.csv` is missing or is not such a table, [`TrainError::Io`].
    pub fn open(
        folder: &Folder,
        fold: Fold,
        folder_index: usize,
        limits: PhotoLimits,
    ) -> Result<Self, TrainError> {
        let split = match fold {
            Fold::Training => "Train",
            Fold::Validation => "Val",
        };
        let root = folder.path.join(split);
        let file = root.join("gt_matches.csv");
        let missing =
            |what: &str| layout_error(folder, &format!("{split}/gt_matches.csv ({what})"));
        if !file.is_file() {
            return Err(missing("the file"));
        }
        let rows: Vec<MatchRow> = csv::Reader::from_reader(fs_err::File::open(&file)?)
            .deserialize()
            .collect::<Result<_, csv::Error>>()
            .map_err(|error| missing(&format!("with columns query_name and ref_name: {error}")))?;
        let positions = positions_m(&root.join("reference.csv"))?;
        let picture = FIRST_CROSS_VIEW + 2 * folder_index + usize::from(fold == Fold::Validation);
        let mut known = HashMap::new();
        let mut out = Self {
            matches: Vec::with_capacity(rows.len()),
            unreadable: 0,
            limits,
        };
        let is_unreadable = |path: &Path| picture_file::size_px(path, limits).is_err();
        for row in rows {
            let photo = root.join("query_images").join(&row.query_name);
            let map = map_picture(&root, &row.ref_name);
            if is_unreadable(&photo) || is_unreadable(&map) {
                tracing::warn!(photo = %photo.display(), map = %map.display(), "unreadable match skipped");
                out.unreadable += 1;
                continue;
            }
            let number = known.len();
            let number = *known.entry(map.clone()).or_insert(number);
            let window = match positions.get(file_name(&row.ref_name)) {
                Some([east_m, north_m]) => {
                    let half = MAP_PICTURE_M / 2.0;
                    [
                        east_m - half,
                        -north_m - half,
                        east_m + half,
                        -north_m + half,
                    ]
                }
                // Without positions every map picture is a place that overlaps no other.
                None => [2.0 * number as f64, 0.0, 2.0 * number as f64 + 1.0, 1.0],
            };
            out.matches.push(Match {
                photo,
                map,
                place: Place { picture, window },
            });
        }
        Ok(out)
    }

    /// Number of usable matches.
    pub fn len(&self) -> usize {
        self.matches.len()
    }

    /// Whether there are no usable matches.
    pub fn is_empty(&self) -> bool {
        self.matches.is_empty()
    }

    /// Number of matches whose pictures are missing or unreadable.
    pub fn unreadable(&self) -> usize {
        self.unreadable
    }
}

/// `offset_0_None/000001.png`, as the competition's files write it, or the bare file name.
fn map_picture(root: &Path, name: &str) -> PathBuf {
    let folder = root.join("reference_images");
    let path = folder.join(name);
    if path.is_file() {
        return path;
    }
    folder.join("offset_0_None").join(name)
}

fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// Easting and northing of the map pictures of `offset_0_None` by file name; empty if there is no such file.
fn positions_m(file: &Path) -> Result<HashMap<String, [f64; 2]>, TrainError> {
    if !file.is_file() {
        return Ok(HashMap::new());
    }
    let mut out = HashMap::new();
    for row in csv::Reader::from_reader(fs_err::File::open(file)?).deserialize() {
        let row: ReferenceRow = row.map_err(|error| TrainError::Config {
            reason: format!(
                "{}: expected columns easting, northing and name: {error}",
                file.display()
            ),
        })?;
        if !row.name.contains('/') || row.name.starts_with("offset_0_None") {
            let name = file_name(&row.name).to_owned();
            out.insert(name, [row.easting, row.northing]);
        }
    }
    Ok(out)
}

/// A whole picture as a square view: bilinear and antialiased (paper, section 3.1), as paper mode resizes tiles and photos.
fn squared(path: &Path, side_px: u32, limits: PhotoLimits) -> Option<RgbImage> {
    let picture = picture_file::open(path, limits)?;
    let (whole, _) = picture.level(0);
    Some(resize(whole, side_px, side_px, FilterType::Triangle))
}

impl Match {
    fn pair(&self, options: &PairOptions, limits: PhotoLimits) -> Option<Pair> {
        let side_px = options.side_px;
        let sat = squared(&self.map, side_px, limits)?;
        let uav = squared(&self.photo, side_px, limits)?;
        let uav_seen = vec![true; (side_px as usize / 8).pow(2)];
        let labels = vec![LABEL_NONE; uav_seen.len()];
        Some(Pair {
            sat,
            uav,
            uav_seen,
            sat_labels: labels.clone(),
            uav_labels: labels,
            sat_points: Vec::new(),
            uav_points: Vec::new(),
            uav_from_sat_px: Matrix3::identity(),
            mapping: Mapping::Unknown,
            place: self.place,
            scene: None,
        })
    }
}

impl Source for CrossView {
    /// Pairs of places that do not overlap, so that each is a negative of the others.
    fn group(&self, count: usize, options: &PairOptions, random: &mut ChaCha8Rng) -> Vec<Pair> {
        let mut out: Vec<Pair> = Vec::with_capacity(count);
        if self.matches.is_empty() {
            return out;
        }
        for _ in 0..count {
            let chosen = (0..ATTEMPTS).find_map(|_| {
                let one = &self.matches[random.random_range(0..self.matches.len())];
                let overlaps = |pair: &Pair| pair.place.overlap(&one.place) > MOST_OVERLAP;
                if out.iter().any(overlaps) {
                    return None;
                }
                one.pair(options, self.limits)
            });
            out.extend(chosen);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::{Layout, Serves};
    use super::*;
    use image::Rgb;
    use rand::SeedableRng as _;

    /// A folder of the competition's shape: three map pictures of one colour each, 10 m apart but for the last, and two photos
    /// of each.
    fn vtrn(root: &Path) -> Folder {
        for split in ["Train", "Val"] {
            let photos = root.join(split).join("query_images");
            let maps = root.join(split).join("reference_images/offset_0_None");
            std::fs::create_dir_all(&photos).unwrap();
            std::fs::create_dir_all(&maps).unwrap();
            let mut matches = String::from("query_ind,query_name,ref_ind,ref_name,distance\n");
            let mut references = String::from("easting,northing,name\n");
            for i in 0..3u8 {
                let colour = Rgb([60 * i + 20, 200 - 60 * i, 90]);
                let map = RgbImage::from_pixel(100, 100, colour);
                map.save(maps.join(format!("{i:06}.png"))).unwrap();
                let east = if i == 2 { 5000.0 } else { 10.0 * f64::from(i) };
                references.push_str(&format!(
                    "{east},4400000.0,offset_0_None/{i:06}.png\n{east},4400020.0,offset_20_North/{i:06}.png\n"
                ));
                for k in 0..2u8 {
                    let number = 2 * i + k;
                    let photo = RgbImage::from_pixel(120, 90, colour);
                    photo.save(photos.join(format!("{number:06}.png"))).unwrap();
                    matches.push_str(&format!(
                        "{number},{number:06}.png,{i},offset_0_None/{i:06}.png,2.5\n"
                    ));
                }
            }
            std::fs::write(root.join(split).join("gt_matches.csv"), matches).unwrap();
            std::fs::write(root.join(split).join("reference.csv"), references).unwrap();
        }
        Folder {
            path: root.to_owned(),
            layout: Layout::Vtrn,
            repeat: 1,
            serves: Serves::Retrieval,
        }
    }

    #[test]
    fn a_photo_comes_with_the_map_picture_that_the_table_names() {
        let root = tempfile::tempdir().unwrap();
        let folder = vtrn(root.path());
        std::fs::remove_file(root.path().join("Train/query_images/000000.png")).unwrap();
        let source = CrossView::open(&folder, Fold::Training, 0, PhotoLimits::DEFAULT).unwrap();
        assert_eq!((source.len(), source.unreadable()), (5, 1));
        let options = PairOptions {
            side_px: 64,
            ..PairOptions::default()
        };
        for seed in 0..8 {
            let group = source.group(3, &options, &mut ChaCha8Rng::seed_from_u64(seed));
            // Two of the three map pictures overlap.
            assert_eq!(group.len(), 2);
            assert!(group[0].place.overlap(&group[1].place) == 0.0);
            for pair in &group {
                assert_eq!(pair.sat.dimensions(), (64, 64));
                assert_eq!(pair.sat.get_pixel(30, 30), pair.uav.get_pixel(30, 30));
                assert!(pair.uav_seen.iter().all(|seen| *seen) && pair.sat_points.is_empty());
            }
        }
    }

    /// At half of the picture's size its stripes are grey.
    #[test]
    fn a_picture_of_vtrn_keeps_the_detail_that_its_view_can_show() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stripes.png");
        let stripe = |x: u32| 255 * u8::from(matches!(x % 4, 1 | 2));
        let picture = RgbImage::from_fn(500, 500, |x, _| Rgb([stripe(x); 3]));
        picture.save(&path).unwrap();
        let view = squared(&path, 320, PhotoLimits::DEFAULT).unwrap();
        let row = (100..200).map(|x| view.get_pixel(x, 160)[0]);
        let (least, most) = row.fold((255, 0), |(least, most), v| (v.min(least), v.max(most)));
        assert!(most - least > 100, "{least} to {most}");
    }

    #[test]
    fn the_folds_and_folders_share_no_place() {
        let root = tempfile::tempdir().unwrap();
        let folder = vtrn(root.path());
        let place = |fold, index| {
            CrossView::open(&folder, fold, index, PhotoLimits::DEFAULT)
                .unwrap()
                .matches[0]
                .place
        };
        let first = place(Fold::Training, 0);
        assert_eq!(first.overlap(&place(Fold::Validation, 0)), 0.0);
        assert_eq!(first.overlap(&place(Fold::Training, 1)), 0.0);
        assert_eq!(first.overlap(&place(Fold::Training, 0)), 1.0);
    }

    #[test]
    fn without_positions_equal_map_pictures_are_one_place_and_others_are_not() {
        let root = tempfile::tempdir().unwrap();
        let folder = vtrn(root.path());
        std::fs::remove_file(root.path().join("Train/reference.csv")).unwrap();
        let source = CrossView::open(&folder, Fold::Training, 0, PhotoLimits::DEFAULT).unwrap();
        let places: Vec<Place> = source.matches.iter().map(|m| m.place).collect();
        assert_eq!(places[0].overlap(&places[1]), 1.0);
        assert_eq!(places[1].overlap(&places[2]), 0.0);
    }

    #[test]
    fn a_missing_or_foreign_table_is_named() {
        let root = tempfile::tempdir().unwrap();
        let folder = vtrn(root.path());
        let table = root.path().join("Train/gt_matches.csv");
        std::fs::write(&table, "a,b\n1,2\n").unwrap();
        let error = CrossView::open(&folder, Fold::Training, 0, PhotoLimits::DEFAULT).unwrap_err();
        assert!(error.to_string().contains("query_name"), "{error}");
        std::fs::remove_file(table).unwrap();
        let error = CrossView::open(&folder, Fold::Training, 0, PhotoLimits::DEFAULT).unwrap_err();
        assert!(error.to_string().contains("gt_matches.csv"), "{error}");
    }
}
