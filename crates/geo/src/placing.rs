//! Where a picture says that it lies.

use std::path::{Path, PathBuf};

use crate::geokeys::{FileCrs, crs_from_geokeys};
use crate::map_options::MapOptions;
use crate::pam::{find_pam, pam_path, read_pam};
use crate::sidecar_values::SidecarValues;
use crate::stated_crs::StatedCrs;
use crate::tiff::TiffMap;
use crate::tiff_georeference::{TiffPlace, place_of};
use crate::world_file::{find_prj, find_world_file, read_prj, read_world_file};
use crate::{Affine, Corners, Crs, GeoError, Georeference, LonLat, offset_en_m};

const CORNERS_ORDER: &str = "the order is LL_LON,LL_LAT,UR_LON,UR_LAT";

/// A coordinate system that moves the centre of a map by less than this is another name of the same one, metres.
const SAME_PLACE_M: f64 = 5.0;

/// Where a picture lies.
pub(crate) struct Placed {
    pub georeference: Georeference,
    /// Values of files beside the picture that the map takes.
    pub sidecars: SidecarValues,
    /// What may be wrong, a sentence each.
    pub caveats: Vec<String>,
}

impl From<Georeference> for Placed {
    fn from(georeference: Georeference) -> Self {
        Self {
            georeference,
            sidecars: SidecarValues::default(),
            caveats: Vec::new(),
        }
    }
}

/// The place of a GeoTIFF: of the options, of its tags, of GDAL's `.aux.xml`, of a world file.
pub(crate) fn place_tiff(
    path: &Path,
    map: &TiffMap,
    crs: Option<Crs>,
    options: &MapOptions,
) -> Result<Placed, GeoError> {
    let own = place_of(&map.images().levels[0].image).map_err(|e| e.in_file(path))?;
    let mut placed = place(path, &own, map.pam(), crs, options, map.size_px())?;
    placed.sidecars.nodata = map.nodata_beside();
    Ok(placed)
}

/// The place of a picture that has none in its file: of the options, of GDAL's `.aux.xml`, of a world file.
pub(crate) fn place_picture(
    path: &Path,
    crs: Option<Crs>,
    options: &MapOptions,
    size_px: (u64, u64),
) -> Result<Placed, GeoError> {
    let own = TiffPlace {
        other: Some("the picture has none, and there is no world file"),
        ..TiffPlace::default()
    };
    let pam = match read_pam(path) {
        // It is not needed.
        Err(_) if options.corners.is_some() => SidecarValues::default(),
        pam => pam?,
    };
    place(path, &own, &pam, crs, options, size_px)
}

/// The place of a picture, and a caveat if the options put it elsewhere than its files do.
fn place(
    path: &Path,
    own: &TiffPlace,
    pam: &SidecarValues,
    crs: Option<Crs>,
    options: &MapOptions,
    size_px: (u64, u64),
) -> Result<Placed, GeoError> {
    let mut placed = match corners_georeference(&crs, options, size_px)? {
        Some(georeference) => georeference.into(),
        None => place_by_files(path, own, pam, &crs, size_px)?,
    };
    if (crs.is_some() || options.corners.is_some())
        && let Ok(stated) = place_by_files(path, own, pam, &None, size_px)
    {
        let caveat = stated_elsewhere(&stated.georeference, &placed.georeference);
        placed.caveats.extend(caveat);
    }
    Ok(placed)
}

/// The place that the files state; `crs` takes the place of their coordinate system.
fn place_by_files(
    path: &Path,
    own: &TiffPlace,
    pam: &SidecarValues,
    crs: &Option<Crs>,
    size_px: (u64, u64),
) -> Result<Placed, GeoError> {
    let own_crs = match (crs, &own.geokeys) {
        (Some(crs), _) => Some(crs.clone().into()),
        (None, Some(keys)) => match crs_from_geokeys(keys, path) {
            // Some files have keys for other things only.
            Err(GeoError::MissingCrs { .. }) if pam.crs != StatedCrs::Absent => None,
            crs => Some(crs?),
        },
        (None, None) => None,
    };
    let mut sidecars = SidecarValues::default();
    let (affine, without_crs) = match own.affine {
        Some(affine) => (
            affine,
            "the file has a transform but no GeoKeys".to_string(),
        ),
        None => {
            let (affine, file) = affine_beside(path, pam)?.ok_or_else(|| {
                let reason = own
                    .other
                    .unwrap_or("it has no GeoTIFF tags, and there is no world file");
                no_georeference(path, reason)
            })?;
            sidecars.affine = Some(affine);
            let reason = format!("{} does not give one, and no .prj", file.display());
            (affine, reason)
        }
    };
    // Some writers store the transform in the file and the coordinate system beside it, or the other way round.
    let file_crs = match own_crs {
        Some(crs) => crs,
        None => {
            let (crs, file) = crs_beside(path, pam)?;
            sidecars.crs = crs.clone();
            crs.in_file(&file)?
                .ok_or_else(|| GeoError::MissingCrs {
                    path: path.to_path_buf(),
                    reason: without_crs,
                })?
                .into()
        }
    };
    let georeference = georeference(path, affine, file_crs.clone(), size_px)?;
    let mut of_pam = pam.clone();
    if crs.is_some() {
        of_pam.crs = StatedCrs::Absent;
    }
    let caveat = match &of_pam.crs {
        StatedCrs::Unknown { name, reason } => Some(unknown_in_pam(name, reason)),
        _ => pam_elsewhere(path, &of_pam, affine, file_crs, &georeference, size_px),
    };
    Ok(Placed {
        georeference,
        sidecars,
        caveats: caveat.into_iter().collect(),
    })
}

/// The transform that a file beside a picture gives, and that file.
fn affine_beside(path: &Path, pam: &SidecarValues) -> Result<Option<(Affine, PathBuf)>, GeoError> {
    if let (Some(affine), Some(file)) = (pam.affine, find_pam(path)) {
        return Ok(Some((affine, file)));
    }
    let Some(file) = find_world_file(path) else {
        return Ok(None);
    };
    Ok(Some((read_world_file(&file)?, file)))
}

/// The coordinate system that a file beside a picture gives, and that file.
fn crs_beside(path: &Path, pam: &SidecarValues) -> Result<(StatedCrs, PathBuf), GeoError> {
    match find_prj(path).filter(|_| pam.crs == StatedCrs::Absent) {
        Some(file) => Ok((read_prj(&file)?, file)),
        None => Ok((pam.crs.clone(), pam_path(path))),
    }
}

/// In a sentence, where GDAL's `.aux.xml` puts a file, if its tags put it elsewhere: GDAL prefers the former.
fn pam_elsewhere(
    path: &Path,
    pam: &SidecarValues,
    affine: Affine,
    crs: FileCrs,
    used: &Georeference,
    size_px: (u64, u64),
) -> Option<String> {
    if pam.affine.is_none() && pam.crs.known().is_none() {
        return None;
    }
    let crs = pam.crs.known().cloned().map_or(crs, FileCrs::from);
    let of_pam = georeference(path, pam.affine.unwrap_or(affine), crs, size_px).ok()?;
    let (centre, apart_m) = elsewhere(&of_pam, used)?;
    Some(format!(
        "its .aux.xml puts the centre at {:.6}, {:.6} (latitude, longitude), {apart_m:.0} m from where the tags of the GeoTIFF put it, which \
         are used; GDAL takes the .aux.xml: where that is right, write it into the map: gdal_translate IN OUT.tif",
        centre.lat_deg, centre.lon_deg
    ))
}

/// In a sentence, that GDAL's `.aux.xml` states a coordinate system that is not known, and that of the file's tags is used.
fn unknown_in_pam(name: &str, reason: &str) -> String {
    format!(
        "its .aux.xml states the coordinate system '{name}', which is not known ({reason}); that of the tags of the GeoTIFF is used. GDAL \
         takes the .aux.xml: where that is right, write it into the map: gdalwarp -t_srs EPSG:4326 IN OUT.tif"
    )
}

/// What the files state of a map's place, in a sentence, if the options put it elsewhere.
pub(crate) fn stated_elsewhere(stated: &Georeference, used: &Georeference) -> Option<String> {
    let (centre, apart_m) = elsewhere(stated, used)?;
    Some(format!(
        "the file itself states {} and a centre at {:.6}, {:.6} (latitude, longitude); the coordinate system or corners that were given put \
         it {apart_m:.0} m away and are used: leave them out unless the file is wrong",
        stated.crs(),
        centre.lat_deg,
        centre.lon_deg
    ))
}

/// The centre of a map in a place that is not the one in use, and the metres between the two.
fn elsewhere(other: &Georeference, used: &Georeference) -> Option<(LonLat, f64)> {
    let centre = |place: &Georeference| place.lonlat_from_map_px(place.centre_px()).ok();
    let (of_other, of_used) = (centre(other)?, centre(used)?);
    let (east_m, north_m) = offset_en_m(of_other, of_used);
    let apart_m = east_m.hypot(north_m);
    (apart_m > SAME_PLACE_M).then_some((of_other, apart_m))
}

/// An error about a picture that does not say where it lies.
fn no_georeference(path: &Path, reason: &str) -> GeoError {
    GeoError::NoGeoreference {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    }
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
