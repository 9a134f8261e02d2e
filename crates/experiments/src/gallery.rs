//! A large gallery: the map, with foreign pictures as distractors beside it.
//!
//! Retrieval on a small map is easy. Foreign pictures beside the map, in the same pixel frame, make the search as hard as on a
//! large map, while pack, search, vote and matching stay the same. The foreign pictures get coordinates that are not theirs; an
//! answer there is wrong.

use std::path::{Path, PathBuf};

use grimnet_geo::{
    GeoError, Georeference, LevelFrame, LevelPx, MapOptions, Raster, RasterPatch, WindowPx,
    open_map,
};
use grimnet_photo::pictures::{EXTENSIONS, picture_files};
use image::{GrayImage, RgbImage};

/// Foreign pictures are cut to whole multiples of this many level pixels: the side of the pack's feature cells, so that tiles
/// inside a picture are whole.
const CELL_PX: u64 = grimnet_pack::CELL_PX as u64;

/// Empty level pixels between the map and the foreign ground: a tile's side, so that no tile shows both.
const GAP_PX: u64 = 512;

/// Side of a degree of longitude or latitude at the equator, metres (WGS 84: 111,320 and 110,574).
const EQUATOR_M_PER_DEG: [f64; 2] = [111_320.0, 110_574.0];

/// Why foreign pictures cannot be used as distractors.
#[derive(Debug, thiserror::Error)]
pub enum GalleryError {
    /// A file or folder could not be read.
    #[error("cannot read the distractors: {0}")]
    Io(#[from] std::io::Error),
    /// A map or picture could not be read.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// A folder holds no pictures.
    #[error("{0}: no pictures (looked for {extensions})", extensions = EXTENSIONS.join(", "))]
    Empty(PathBuf),
    /// No foreign picture is as large as a cell.
    #[error(
        "{path}: no picture covers {CELL_PX} x {CELL_PX} pixels at {gsd_m} m per pixel; choose a finer resolution"
    )]
    TooSmall {
        /// File or folder.
        path: PathBuf,
        /// Ground resolution asked for, metres a pixel.
        gsd_m: f64,
    },
}

/// Opens a foreign map, or all pictures of a folder. A picture without a georeference is assumed to have `gsd_m` metres per
/// pixel.
///
/// # Errors
/// The folder is empty or a picture cannot be read.
pub fn open_foreign(path: &Path, gsd_m: f64) -> Result<Vec<Box<dyn Raster>>, GalleryError> {
    if !path.is_dir() {
        return Ok(vec![open_one(path, gsd_m)?]);
    }
    let paths = picture_files(path)?;
    if paths.is_empty() {
        return Err(GalleryError::Empty(path.to_owned()));
    }
    paths.iter().map(|path| open_one(path, gsd_m)).collect()
}

fn open_one(path: &Path, gsd_m: f64) -> Result<Box<dyn Raster>, GalleryError> {
    match open_map(path, &MapOptions::default()) {
        Err(GeoError::NoGeoreference { .. }) => {}
        opened => return Ok(opened?),
    }
    let (width, height) = image::image_dimensions(path).map_err(std::io::Error::other)?;
    // Placed on the equator, where degrees and metres are proportional; only the resolution matters.
    let corners = Some([
        0.0,
        0.0,
        f64::from(width) * gsd_m / EQUATOR_M_PER_DEG[0],
        f64::from(height) * gsd_m / EQUATOR_M_PER_DEG[1],
    ]);
    let options = MapOptions {
        corners,
        ..MapOptions::default()
    };
    Ok(open_map(path, &options)?)
}

/// One foreign raster and its window in the frame of the gallery.
struct Foreign {
    raster: Box<dyn Raster>,
    /// Its window, map pixels.
    place: WindowPx,
    /// Its own pixels per map pixel, along x and y.
    own_px_per_map_px: [f64; 2],
}

/// A map with foreign pictures beside it, as one raster in the map's pixel frame and georeference.
pub struct Gallery {
    map: Box<dyn Raster>,
    foreign: Vec<Foreign>,
    size_px: (u64, u64),
}

impl Gallery {
    /// Places `foreign` beside `map`, edge to edge, in columns about as high as the map, each at its ground resolution. `gsd_m` is
    /// the resolution of the level that will be searched.
    ///
    /// # Errors
    /// A resolution is not known, or no foreign picture covers a whole cell; the error then names `path`.
    pub fn new(
        map: Box<dyn Raster>,
        foreign: Vec<Box<dyn Raster>>,
        gsd_m: f64,
        path: &Path,
    ) -> Result<Self, GalleryError> {
        let frame = LevelFrame::new(map.georeference(), map.size_px(), gsd_m)?;
        let sizes = foreign
            .iter()
            .map(|raster| {
                let own = LevelFrame::new(raster.georeference(), raster.size_px(), gsd_m)?;
                Ok((own, [own.width_px, own.height_px].map(whole_cells)))
            })
            .collect::<Result<Vec<_>, GeoError>>()?;
        let places = columns(
            &sizes.iter().map(|s| s.1).collect::<Vec<_>>(),
            frame.height_px,
        );
        let left_px = frame.width_px.next_multiple_of(CELL_PX) + GAP_PX;
        let mut size_px = [left_px, frame.height_px.next_multiple_of(CELL_PX)];
        let mut laid = Vec::new();
        for ((raster, (own, side)), place) in foreign.into_iter().zip(sizes).zip(places) {
            if side.contains(&0) {
                continue;
            }
            let at = [left_px + place[0], place[1]];
            for axis in 0..2 {
                size_px[axis] = size_px[axis].max(at[axis] + side[axis]);
            }
            laid.push(Foreign {
                raster,
                place: frame.map_window(
                    LevelPx::new(at[0] as f64, at[1] as f64),
                    side[0] as f64,
                    side[1] as f64,
                ),
                own_px_per_map_px: [
                    own.map_px_per_level_px_x / frame.map_px_per_level_px_x,
                    own.map_px_per_level_px_y / frame.map_px_per_level_px_y,
                ],
            });
        }
        if laid.is_empty() {
            return Err(GalleryError::TooSmall {
                path: path.to_owned(),
                gsd_m,
            });
        }
        let whole = frame.map_px_from_level_px(LevelPx::new(size_px[0] as f64, size_px[1] as f64));
        Ok(Self {
            map,
            foreign: laid,
            size_px: (whole.x.round() as u64, whole.y.round() as u64),
        })
    }
}

/// Level pixels of a side that fill whole cells.
fn whole_cells(side_px: u64) -> u64 {
    side_px / CELL_PX * CELL_PX
}

/// Top-left corners of rectangles stacked in columns of at most `height`; a higher rectangle gets a separate column.
fn columns(sizes: &[[u64; 2]], height: u64) -> Vec<[u64; 2]> {
    let (mut left, mut top, mut width) = (0, 0, 0);
    sizes
        .iter()
        .map(|&[w, h]| {
            if top > 0 && top + h > height {
                (left, top, width) = (left + width, 0, 0);
            }
            let place = [left, top];
            (top, width) = (top + h, width.max(w));
            place
        })
        .collect()
}

impl Raster for Gallery {
    fn size_px(&self) -> (u64, u64) {
        self.size_px
    }

    fn georeference(&self) -> &Georeference {
        self.map.georeference()
    }

    fn content_hash(&self) -> Result<[u8; 32], GeoError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.map.content_hash()?);
        for foreign in &self.foreign {
            hasher.update(&foreign.raster.content_hash()?);
            let WindowPx { x, y, w, h } = foreign.place;
            for along in [x, y, w, h] {
                hasher.update(&along.to_le_bytes());
            }
        }
        Ok(hasher.finalize().into())
    }

    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        let (width, height) = self.map.size_px();
        let of_map = WindowPx::new(0.0, 0.0, width as f64, height as f64);
        let mut patch = if overlap(&window, &of_map) {
            self.map.read(window, out_w, out_h)?
        } else {
            RasterPatch {
                rgb: RgbImage::new(out_w, out_h),
                valid: GrayImage::new(out_w, out_h),
            }
        };
        for foreign in self.foreign.iter().filter(|f| overlap(&window, &f.place)) {
            let [sx, sy] = foreign.own_px_per_map_px;
            let own = WindowPx::new(
                (window.x - foreign.place.x) * sx,
                (window.y - foreign.place.y) * sy,
                window.w * sx,
                window.h * sy,
            );
            let seen = foreign.raster.read(own, out_w, out_h)?;
            let inside = |x: u32, y: u32| {
                let at = |start: f64, side: f64, i: u32, n: u32| {
                    start + (f64::from(i) + 0.5) * side / f64::from(n)
                };
                contains(
                    &foreign.place,
                    at(window.x, window.w, x, out_w),
                    at(window.y, window.h, y, out_h),
                )
            };
            for (x, y, valid) in seen.valid.enumerate_pixels() {
                if valid.0[0] != 0 && inside(x, y) {
                    patch.valid.put_pixel(x, y, *valid);
                    patch.rgb.put_pixel(x, y, *seen.rgb.get_pixel(x, y));
                }
            }
        }
        Ok(patch)
    }

    fn describe(&self) -> String {
        format!(
            "{}, with {} distractor pictures beside it",
            self.map.describe(),
            self.foreign.len()
        )
    }
}

fn overlap(a: &WindowPx, b: &WindowPx) -> bool {
    a.x < b.x + b.w && b.x < a.x + a.w && a.y < b.y + b.h && b.y < a.y + a.h
}

fn contains(window: &WindowPx, x: f64, y: f64) -> bool {
    (window.x..window.x + window.w).contains(&x) && (window.y..window.y + window.h).contains(&y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    fn picture(folder: &Path, name: &str, side: u32, colour: Rgb<u8>) -> PathBuf {
        let path = folder.join(name);
        RgbImage::from_pixel(side, side, colour)
            .save(&path)
            .unwrap();
        path
    }

    #[test]
    fn columns_fill_the_height_of_the_map() {
        let places = columns(&[[512, 512], [768, 512], [256, 256], [512, 2048]], 1024);
        assert_eq!(places, [[0, 0], [0, 512], [768, 0], [1024, 0]]);
    }

    #[test]
    fn foreign_pictures_lie_beside_the_map_at_their_scale() {
        let folder = tempfile::tempdir().unwrap();
        let (red, green) = (Rgb([200, 0, 0]), Rgb([0, 200, 0]));
        // Half a metre a pixel on the equator; the level that is searched has one metre.
        let map = open_one(&picture(folder.path(), "map.png", 1000, red), 0.5).unwrap();
        let foreign = folder.path().join("foreign");
        fs_err::create_dir(&foreign).unwrap();
        picture(&foreign, "a.png", 600, green);
        picture(&foreign, "small.png", 100, green);
        let opened = open_foreign(&foreign, 1.0).unwrap();
        let gallery = Gallery::new(map, opened, 1.0, &foreign).unwrap();
        assert_eq!(gallery.foreign.len(), 1, "the small one fills no cell");
        // The level: 512 of map (500 and the rest of a cell), 512 of nothing, 512 of the 600 foreign pixels.
        let (width, height) = gallery.size_px();
        assert!(
            (i64::try_from(width).unwrap() - 3072).abs() <= 4
                && (i64::try_from(height).unwrap() - 1024).abs() <= 4,
            "{width} {height}"
        );
        let frame = LevelFrame::new(gallery.georeference(), gallery.size_px(), 1.0).unwrap();
        let seen = gallery
            .read(
                frame.map_window(LevelPx::new(0.0, 0.0), 1536.0, 512.0),
                1536,
                512,
            )
            .unwrap();
        let at = |x: u32| {
            (
                seen.rgb.get_pixel(x, 250).0,
                seen.valid.get_pixel(x, 250).0[0],
            )
        };
        assert_eq!(at(250), (red.0, 255));
        assert_eq!(at(700).1, 0);
        assert_eq!(at(1300), (green.0, 255));
    }

    #[test]
    fn what_is_not_there_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = open_foreign(folder.path(), 1.0).err().unwrap();
        assert!(error.to_string().contains("no pictures"), "{error}");
        let path = picture(folder.path(), "small.png", 100, Rgb([9, 9, 9]));
        let map = open_one(&path, 1.0).unwrap();
        let error = Gallery::new(map, open_foreign(&path, 1.0).unwrap(), 1.0, &path)
            .err()
            .unwrap();
        assert!(error.to_string().contains("small.png"), "{error}");
    }
}
