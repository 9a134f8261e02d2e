//! What looks wrong with a map, before work is spent on it.

use image::RgbImage;
use std::fmt;

use crate::corners::{ODD_ASPECT, SQUARE_ASPECT, SQUARE_IN_DEGREES};
use crate::{GeoError, Georeference, MapPx, Raster, RasterPatch, WindowPx, turn_deg};

/// Longer side of the picture of a map that is looked at, pixels.
const PICTURE_PX: u32 = 512;
/// Larger maps are looked at in samples, pixels.
const MAX_WHOLE_PX: u64 = 1 << 28;
/// Samples along the longer side, and the side of one in map pixels.
const SAMPLES: u32 = 48;
const SAMPLE_PX: f64 = 32.0;
/// Darkest pixel that is not black, the sum of its colours.
const BLACK_SUM: u16 = 12;
/// Share of the map above which missing or black parts are reported.
const MUCH: f64 = 0.4;
/// Standard deviation of brightness below which a map is of one colour, grey values.
const FLAT: f64 = 3.0;
/// Ground resolutions that maps for drone photos have, metres per pixel.
const USUAL_GSD_M: std::ops::RangeInclusive<f64> = 0.01..=1.0;
/// Larger pixels are not those of a map in degrees, units of its coordinates (100 m if they were degrees).
const MAX_PIXEL_DEG: f64 = 1e-3;
/// Maps nearer to latitude 0, longitude 0 are there by mistake, degrees.
const NULL_ISLAND_DEG: f64 = 1.0;
/// Ratio of ground resolutions at the edges above which one number does not describe it.
const UNEVEN: f64 = 1.05;
/// Difference between the bearings of up at the corners and at the centre above which one does not describe it, degrees. Headings have
/// errors of their own, and descriptors tolerate a turn of about 15 degrees.
const UNEVEN_DEG: f64 = 10.0;
/// Degrees by which the angle between rows and columns on the ground differs from a right one, above which it is reported: photos are
/// turned and scaled to fit a map and not sheared. On a map of noise all photos had a fix at 11 degrees, one of three at 15, none at 19.
const SHEARED_DEG: f64 = 10.0;

/// Something that looks wrong. The map can be used all the same.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Concern {
    /// Longitude and latitude have probably changed places.
    SwappedAxes {
        /// Width over height of a pixel on the ground.
        aspect: f64,
    },
    /// The coordinates are those of degrees, and the coordinate system is one of metres.
    DegreesAsMetres {
        /// Of the top-left corner.
        x: f64,
        /// Of the top-left corner.
        y: f64,
    },
    /// It lies at latitude 0, longitude 0.
    NullIsland,
    /// A large part has no data.
    NoData {
        /// `0.0..=1.0`.
        share: f64,
    },
    /// A large part is black, and not marked as without data.
    Black {
        /// `0.0..=1.0`.
        share: f64,
    },
    /// Hardly any structure.
    OneColour,
    /// A pixel shows more or less ground than maps for drone photos do.
    Resolution {
        /// Metres per pixel.
        gsd_m: f64,
    },
    /// The ground resolution differs between the edges.
    UnevenResolution {
        /// The finest and the coarsest, metres per pixel.
        gsd_m: (f64, f64),
    },
    /// Rows and columns are far from a right angle on the ground, as those of a map in degrees that is turned.
    Sheared {
        /// Difference from a right angle at the centre, degrees.
        off_deg: f64,
    },
    /// North lies in other directions at the corners than at the centre, as around a pole.
    UnevenNorth {
        /// The largest difference, degrees.
        turn_deg: f64,
    },
    /// What the map's files say.
    Source(String),
}

impl Concern {
    /// A name for programs.
    pub fn name(&self) -> &'static str {
        match self {
            Self::SwappedAxes { .. } => "swapped_axes",
            Self::DegreesAsMetres { .. } => "degrees_as_metres",
            Self::NullIsland => "null_island",
            Self::NoData { .. } => "no_data",
            Self::Black { .. } => "black",
            Self::OneColour => "one_colour",
            Self::Resolution { .. } => "resolution",
            Self::UnevenResolution { .. } => "uneven_resolution",
            Self::Sheared { .. } => "sheared",
            Self::UnevenNorth { .. } => "uneven_north",
            Self::Source(_) => "source",
        }
    }
}

impl fmt::Display for Concern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SwappedAxes { aspect } => write!(
                f,
                "longitude and latitude look swapped: a pixel is {aspect:.2} times as wide as high on the ground, and nearly \
                 square with the two exchanged; x must be the longitude"
            ),
            Self::DegreesAsMetres { x, y } => write!(
                f,
                "its coordinates ({x:.5}, {y:.5}) look like degrees, and its coordinate system has metres; it is probably \
                 EPSG:4326"
            ),
            Self::NullIsland => f.write_str(
                "it lies at latitude 0, longitude 0, in the sea off Africa; its georeference is probably empty",
            ),
            Self::NoData { share } => write!(
                f,
                "{:.0} % of it have no data: photos of these parts get no fix",
                100.0 * share
            ),
            Self::Black { share } => write!(
                f,
                "{:.0} % of it are black: photos of these parts get no fix; if black means no data, mark it: gdal_translate \
                 -a_nodata 0 IN OUT.tif",
                100.0 * share
            ),
            Self::OneColour => f.write_str(
                "it has hardly any structure; check which layer and bands it shows",
            ),
            Self::Resolution { gsd_m } if *gsd_m > *USUAL_GSD_M.end() => write!(
                f,
                "{gsd_m:.2} m of ground in a pixel is coarse for drone photos: one that is 150 m wide covers {:.0} pixels of it, \
                 and 500 are needed for the best accuracy",
                150.0 / gsd_m
            ),
            Self::Resolution { gsd_m } => write!(
                f,
                "{:.1} mm of ground in a pixel is implausibly fine; check its coordinate system and scale",
                1e3 * gsd_m
            ),
            Self::UnevenResolution { gsd_m: (fine, coarse) } => write!(
                f,
                "its ground resolution differs between its edges ({fine:.3} to {coarse:.3} m per pixel): the levels of a pack are \
                 right at its centre; cut it into smaller maps"
            ),
            Self::Sheared { off_deg } => write!(
                f,
                "it is sheared: its rows and columns are {off_deg:.0} degrees from a right angle on the ground, and photos get no fix \
                 on it; turn it north up: gdalwarp IN OUT.tif"
            ),
            Self::UnevenNorth { turn_deg } => write!(
                f,
                "north lies up to {turn_deg:.0} degrees from where it lies at its centre: photos are turned by their heading as at the \
                 centre, and elsewhere get no fix; cut it into smaller maps, or search with the heading unknown"
            ),
            Self::Source(text) => f.write_str(text),
        }
    }
}

/// A small picture of a map, made of its overviews, or of samples if it is large.
///
/// # Errors
/// As [`Raster::read`].
pub fn overview(map: &dyn Raster) -> Result<RasterPatch, GeoError> {
    let (width, height) = map.size_px();
    let longer = width.max(height) as f64;
    let fit =
        |side: u64, most: u32| ((side as f64 / longer * f64::from(most)).round() as u32).max(1);
    if width.saturating_mul(height) <= MAX_WHOLE_PX {
        let most = PICTURE_PX.min(longer as u32);
        let whole = WindowPx::new(0.0, 0.0, width as f64, height as f64);
        return map.read(whole, fit(width, most), fit(height, most));
    }
    let (columns, rows) = (fit(width, SAMPLES), fit(height, SAMPLES));
    let mut patch = RasterPatch {
        rgb: RgbImage::new(columns, rows),
        valid: image::GrayImage::new(columns, rows),
    };
    for row in 0..rows {
        for column in 0..columns {
            let middle = |i: u32, count: u32, side: u64| {
                (f64::from(i) + 0.5) / f64::from(count) * side as f64 - 0.5 * SAMPLE_PX
            };
            let (x, y) = (middle(column, columns, width), middle(row, rows, height));
            let sample = map.read(WindowPx::new(x, y, SAMPLE_PX, SAMPLE_PX), 1, 1)?;
            patch
                .rgb
                .put_pixel(column, row, *sample.rgb.get_pixel(0, 0));
            patch
                .valid
                .put_pixel(column, row, *sample.valid.get_pixel(0, 0));
        }
    }
    Ok(patch)
}

/// What looks wrong with a map, from its georeference and its [`overview`].
///
/// # Errors
/// Returns [`GeoError::OutsideDomain`] if the map's centre has no position on Earth.
pub fn concerns(map: &dyn Raster, overview: &RasterPatch) -> Result<Vec<Concern>, GeoError> {
    let mut found = concerns_of_place(map)?;
    found.extend(of_pixels(overview));
    found.extend(
        map.georeference()
            .crs()
            .caveat()
            .map(|c| Concern::Source(c.to_string())),
    );
    found.extend(map.caveats().into_iter().map(Concern::Source));
    Ok(found)
}

/// What looks wrong with a map's georeference. No pixel is read.
///
/// # Errors
/// As [`concerns`].
pub fn concerns_of_place(map: &dyn Raster) -> Result<Vec<Concern>, GeoError> {
    let mut found = Vec::new();
    let georeference = map.georeference();
    let centre = georeference.centre_px();
    let place = georeference.lonlat_from_map_px(centre)?;
    let (x_m, y_m) = georeference.ground_resolution_m(centre)?;
    let gsd_m = (x_m * y_m).sqrt();
    let (x, y) = georeference.affine().xy_from_map_px(MapPx::new(0.0, 0.0));
    let (right, bottom) = georeference
        .affine()
        .xy_from_map_px(MapPx::new(2.0 * centre.x, 2.0 * centre.y));
    let crs = georeference.crs();
    let like_degrees = |x: f64, y: f64| x.abs() <= 360.0 && y.abs() <= 90.0;
    let [_, width, _, _, turned, _] = georeference.affine().to_gdal();
    if !crs.is_geographic()
        && width.hypot(turned) < MAX_PIXEL_DEG
        && like_degrees(x, y)
        && like_degrees(right, bottom)
    {
        found.push(Concern::DegreesAsMetres { x, y });
        return Ok(found);
    }
    if place.lon_deg.abs() < NULL_ISLAND_DEG && place.lat_deg.abs() < NULL_ISLAND_DEG {
        found.push(Concern::NullIsland);
    }
    if crs.is_geographic() && place.lon_deg.abs() < 89.0 {
        // A pixel of degrees is narrower by the cosine of the latitude.
        let narrower = |lat_deg: f64| lat_deg.to_radians().cos();
        let aspect = x_m / y_m;
        let swapped = aspect * narrower(place.lon_deg) / narrower(place.lat_deg);
        let off = |a: f64| a.max(1.0 / a);
        // Pixels that are square in degrees are usual, and tell nothing.
        let in_degrees = aspect / narrower(place.lat_deg);
        if off(in_degrees) > SQUARE_IN_DEGREES
            && off(aspect) > ODD_ASPECT
            && off(swapped) < SQUARE_ASPECT
        {
            found.push(Concern::SwappedAxes { aspect });
        }
    }
    if !USUAL_GSD_M.contains(&gsd_m) {
        found.push(Concern::Resolution { gsd_m });
    }
    found.extend(uneven_resolution(georeference, gsd_m));
    let jacobian = georeference.east_north_m_from_map_px_jacobian(centre)?;
    let (across, down) = (jacobian.column(0), jacobian.column(1));
    let cosine = across.dot(&down) / (across.norm() * down.norm());
    let off_deg = cosine.clamp(-1.0, 1.0).asin().to_degrees().abs();
    if off_deg > SHEARED_DEG {
        found.push(Concern::Sheared { off_deg });
    }
    let up_deg = georeference.up_bearing_deg(centre)?;
    let corners = [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0), (2.0, 2.0)];
    let turn_deg = corners
        .iter()
        .filter_map(|(x, y)| {
            let corner = MapPx::new(x * centre.x, y * centre.y);
            georeference.up_bearing_deg(corner).ok()
        })
        .map(|there_deg| turn_deg(up_deg, there_deg).abs())
        .fold(0.0, f64::max);
    if turn_deg > UNEVEN_DEG {
        found.push(Concern::UnevenNorth { turn_deg });
    }
    Ok(found)
}

/// The concern about a map whose ground resolution at the upper or lower edge is far from `gsd_m`, that at its centre.
fn uneven_resolution(georeference: &Georeference, gsd_m: f64) -> Option<Concern> {
    let centre = georeference.centre_px();
    let at_edges: Vec<f64> = [0.0, 2.0 * centre.y]
        .iter()
        .filter_map(|&y| {
            georeference
                .ground_resolution_m(MapPx::new(centre.x, y))
                .ok()
        })
        .map(|(x_m, y_m)| (x_m * y_m).sqrt())
        .collect();
    let fine = at_edges.iter().copied().fold(gsd_m, f64::min);
    let coarse = at_edges.iter().copied().fold(gsd_m, f64::max);
    (coarse > fine * UNEVEN).then_some(Concern::UnevenResolution {
        gsd_m: (fine, coarse),
    })
}

fn of_pixels(overview: &RasterPatch) -> Vec<Concern> {
    let all = f64::from(overview.rgb.width()) * f64::from(overview.rgb.height());
    let mut seen = 0.0;
    let mut black = 0.0;
    let (mut sum, mut squares) = (0.0, 0.0);
    for (pixel, valid) in overview.rgb.pixels().zip(overview.valid.pixels()) {
        if valid.0[0] == 0 {
            continue;
        }
        seen += 1.0;
        let total: u16 = pixel.0.iter().map(|&v| u16::from(v)).sum();
        if total <= BLACK_SUM {
            black += 1.0;
            continue;
        }
        let brightness = f64::from(total) / 3.0;
        sum += brightness;
        squares += brightness * brightness;
    }
    let mut found = Vec::new();
    let no_data = 1.0 - seen / all;
    if no_data >= MUCH {
        found.push(Concern::NoData { share: no_data });
    }
    if black / all >= MUCH {
        found.push(Concern::Black { share: black / all });
    }
    let lit: f64 = seen - black;
    if lit > 0.0 {
        let mean = sum / lit;
        if (squares / lit - mean * mean).max(0.0).sqrt() < FLAT {
            found.push(Concern::OneColour);
        }
    }
    found
}
