//! The definition of an EPSG code: that of the list of `crs-definitions`, with its errors corrected, or of our own list of those that it
//! lacks.

use crate::datum_shifts::with_better_shift;
use crate::units::degrees_per_unit_of_epsg;

/// Codes whose coordinates a definition cannot tell, and what to do.
const REFUSED: [(&[u32], &str); 3] = [
    // PROJ 9 takes x to the south and y to the west, PROJ strings without `+axis` negative ones to the east and north.
    (
        &[2065, 5513],
        "its axes point to the south and west, and maps in it follow them or not; one with negative coordinates is in EPSG:5514, \
         another must be reprojected: gdalwarp -t_srs EPSG:5514 IN OUT",
    ),
    // Gusterberg and St. Stephen Grid of Austria: the list of definitions has no `+axis` for them.
    (
        &[8044, 8045],
        "its axes point to the south and west, and maps in it follow them or not; reproject the map: gdalwarp -t_srs EPSG:4326 IN OUT",
    ),
    // MGI and MGI 1901 of the EPSG registry.
    (
        &[4805],
        "its datum is one in Austria and another in the former Yugoslavia, 300 m apart; reproject the map: gdalwarp -t_srs \
         EPSG:4326 IN OUT",
    ),
];

/// Codes, what the list says of them, and what takes its place.
const CORRECTED: [(&[u32], &str, &str); 5] = [
    // RSO Malaya in chains: the false easting is one in chains too, and PROJ strings have metres.
    (&[3167], "+x_0=40000", "+x_0=804670.24"),
    // EASE-Grid North, South and Global are projected from the sphere of the same area (EPSG methods 1027 and 9834): 14 to 63 km off.
    (
        &[3973, 3974, 3975],
        "+datum=WGS84",
        "+ellps=WGS84 +R_A +nadgrids=@null",
    ),
    // Pseudo-Mercator with a height is projected from the sphere as well: up to 43 km off.
    (
        &[6871],
        "+datum=WGS84",
        "+a=6378137 +b=6378137 +nadgrids=@null",
    ),
    // MGI in the former Yugoslavia, deprecated: 305 m off with Austria's shift; that of MGI 1901, the datum of their successors.
    (
        &[
            2170, 3787, 31265, 31266, 31267, 31268, 31275, 31276, 31277, 31278, 31279,
        ],
        "+datum=hermannskogel",
        "+ellps=bessel +towgs84=682,-203,480,0,0,0,0",
    ),
    // IG05 and IG05/12 of Israel: 78 m off without a shift; WGS 84 to IG05/12 Intermediate CRS, reversed, 0.1 m.
    (
        &[6982, 6983, 6984, 6989, 6990, 6991],
        "+ellps=GRS80",
        "+ellps=GRS80 +towgs84=23.772,17.49,17.859,-0.3132,-1.85274,1.67299,-5.4262",
    ),
];

/// Codes that the list of `crs-definitions` lacks: in each line a code and its PROJ string (`epsg/make_definitions.py`).
const ADDED: &str = include_str!("../epsg/definitions.txt");

fn added(code: u32) -> Option<&'static str> {
    let mut lines = ADDED.lines().filter_map(|line| line.split_once(' '));
    let (_, definition) = lines.find(|(listed, _)| listed.parse() == Ok(code))?;
    Some(definition)
}

/// The PROJ string of an EPSG code.
///
/// # Errors
/// Returns why there is none, and what to do if there is anything.
pub(crate) fn proj_string_of_epsg(code: u32) -> Result<String, &'static str> {
    if degrees_per_unit_of_epsg(code) != 1.0 {
        return Err(
            "its coordinates are in grads, not in degrees; reproject the map: gdalwarp -t_srs EPSG:4326 IN OUT",
        );
    }
    if let Some((_, reason)) = REFUSED.iter().find(|(codes, _)| codes.contains(&code)) {
        return Err(reason);
    }
    let listed = u16::try_from(code)
        .ok()
        .and_then(crs_definitions::from_code)
        .map(|listed| listed.proj4)
        .or_else(|| added(code))
        .ok_or("the code is not in the list of known systems")?;
    let corrected = CORRECTED.iter().find(|(codes, ..)| codes.contains(&code));
    Ok(with_better_shift(&match corrected {
        Some((_, wrong, right)) => listed.replace(wrong, right),
        None => listed.to_string(),
    }))
}
