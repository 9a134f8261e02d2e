//! Where a file says that it lies.

use std::path::Path;

use crate::geokeys::{FileCrs, crs_from_geokeys};
use crate::map_options::MapOptions;
use crate::pam::read_pam;
use crate::tiff::TiffMap;
use crate::tiff_georeference::place_of;
use crate::world_file::{find_world_file, read_world_file};
use crate::{Affine, Corners, Crs, GeoError, Georeference, LonLat, offset_en_m};

const CORNERS_ORDER: &str = "the order is LL_LON,LL_LAT,UR_LON,UR_LAT";

/// A coordinate system that moves the centre of a map by less than this is another name of the same one, metres.
const SAME_PLACE_M: f64 = 5.0;

/// An error about a picture that does not say where it lies.
pub(crate) fn no_georeference(path: &Path, reason: &str) -> GeoError {
    GeoError::NoGeoreference {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    }
}

/// The georeference of a GeoTIFF: of the options, of its tags, of a world file.
pub(crate) fn tiff_georeference(
    path: &Path,
    map: &TiffMap,
    crs: Option<Crs>,
    options: &MapOptions,
) -> Result<Georeference, GeoError> {
    let size_px = map.size_px();
    if let Some(georeference) = corners_georeference(&crs, options, size_px)? {
        return Ok(georeference);
    }
    let place = place_of(&map.images().levels[0].image).map_err(|e| e.in_file(path))?;
    let Some(affine) = place.affine else {
        let pam_crs = crs
            .clone()
            .map(Ok)
            .or_else(|| {
                let keys = place.geokeys.as_ref()?;
                Some(crs_from_geokeys(keys, path).map(|file| file.crs))
            })
            .transpose()?;
        if let Some(georeference) = pam_georeference(path, pam_crs, size_px)? {
            return Ok(georeference);
        }
        // Some writers store the CRS in the file and the transform beside it.
        let crs = match (crs, &place.geokeys) {
            (Some(crs), _) => Some(crs.into()),
            (None, Some(keys)) => Some(crs_from_geokeys(keys, path)?),
            (None, None) => None,
        };
        let reason = place
            .other
            .unwrap_or("it has no GeoTIFF tags, and there is no world file");
        return world_georeference(path, crs, size_px)?
            .ok_or_else(|| no_georeference(path, reason));
    };
    let crs = match (crs, &place.geokeys) {
        (Some(crs), _) => crs.into(),
        (None, Some(keys)) => crs_from_geokeys(keys, path)?,
        (None, None) => {
            return Err(GeoError::MissingCrs {
                path: path.to_path_buf(),
                reason: "the file has a transform but no GeoKeys".to_string(),
            });
        }
    };
    georeference(path, affine, crs, size_px)
}

/// What a GeoTIFF states of its place, in a sentence, if its options put it elsewhere.
pub(crate) fn stated_elsewhere(path: &Path, map: &TiffMap, used: &Georeference) -> Option<String> {
    let stated = tiff_georeference(path, map, None, &MapOptions::default()).ok()?;
    let centre = |place: &Georeference| place.lonlat_from_map_px(place.centre_px()).ok();
    let (of_file, of_options) = (centre(&stated)?, centre(used)?);
    let (east_m, north_m) = offset_en_m(of_file, of_options);
    let apart_m = east_m.hypot(north_m);
    (apart_m > SAME_PLACE_M).then(|| {
        format!(
            "the file itself states {} and a centre at {:.6}, {:.6} (latitude, longitude); the coordinate system or corners that were given put \
             it {apart_m:.0} m away and are used: leave them out unless the file is wrong",
            stated.crs(),
            of_file.lat_deg,
            of_file.lon_deg
        )
    })
}

/// The georeference of the corners in the options, if there are any.
pub(crate) fn corners_georeference(
    crs: &Option<Crs>,
    options: &MapOptions,
    size_px: (u64, u64),
) -> Result<Option<Georeference>, GeoError> {
    let Some([ll_lon, ll_lat, ur_lon, ur_lat]) = options.corners else {
        return Ok(None);
    };
    let location = "corners";
    let crs = match crs {
        None => Crs::wgs84()?,
        Some(crs) if crs.is_geographic() => crs.clone(),
        Some(crs) => {
            return Err(GeoError::BadCorners {
                location: location.to_string(),
                reason: format!(
                    "they are longitude and latitude, and {crs} is projected; give no coordinate system or a geographic one"
                ),
            });
        }
    };
    let (ll, ur) = (LonLat::new(ll_lon, ll_lat), LonLat::new(ur_lon, ur_lat));
    let corners = Corners::new(ll, ur, size_px, location, CORNERS_ORDER)?;
    let affine = corners.affine(size_px)?;
    Ok(Some(Georeference::new(affine, crs, size_px)))
}

/// The georeference that GDAL keeps beside the file, if there is one. `crs` takes the place of its own.
pub(crate) fn pam_georeference(
    path: &Path,
    crs: Option<Crs>,
    size_px: (u64, u64),
) -> Result<Option<Georeference>, GeoError> {
    let pam = read_pam(path)?;
    let (Some(affine), Some(crs)) = (pam.affine, crs.or(pam.crs)) else {
        return Ok(None);
    };
    georeference(path, affine, crs.into(), size_px).map(Some)
}

/// The georeference of a world file, if there is one.
pub(crate) fn world_georeference(
    path: &Path,
    crs: Option<FileCrs>,
    size_px: (u64, u64),
) -> Result<Option<Georeference>, GeoError> {
    let Some(world_file) = find_world_file(path) else {
        return Ok(None);
    };
    let affine = read_world_file(&world_file)?;
    let crs = crs.ok_or_else(|| GeoError::MissingCrs {
        path: path.to_path_buf(),
        reason: format!("the world file {} does not give it", world_file.display()),
    })?;
    georeference(&world_file, affine, crs, size_px).map(Some)
}

/// Checks that the map lies on Earth. This detects a CRS that does not fit the transform, and swapped axes.
pub(crate) fn georeference(
    path: &Path,
    affine: Affine,
    crs: FileCrs,
    size_px: (u64, u64),
) -> Result<Georeference, GeoError> {
    let affine = affine
        .scaled(crs.crs_units_per_file_unit)
        .map_err(|e| e.in_file(path))?;
    let georeference = Georeference::new(affine, crs.crs, size_px);
    let (x, y) = affine.xy_from_map_px(georeference.centre_px());
    let crs = georeference.crs();
    if crs.is_geographic() && y.abs() > 90.0 && x.abs() <= 90.0 && y.abs() <= 180.0 {
        return Err(GeoError::SwappedLonLat {
            location: path.display().to_string(),
            reason: format!("the map's centre would have latitude {y}"),
            order: "x must be the longitude and y the latitude",
        });
    }
    if let Err(error) = georeference.lonlat_from_map_px(georeference.centre_px()) {
        return Err(GeoError::UnsupportedCrs {
            path: path.to_path_buf(),
            crs: crs.to_string(),
            reason: format!("the map's centre lies outside it ({error})"),
        });
    }
    Ok(georeference)
}
