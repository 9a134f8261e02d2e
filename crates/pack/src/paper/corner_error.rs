//! What the paper's coordinates cost on a map whose columns are not meridians.

use grimnet_geo::{Georeference, LonLat, MapPx, distance_m};

use crate::error::Result;

/// How far eq. 2a, 2b and 23, which are linear between the lower left and the upper right corner, place the map's other two corners
/// and its centre from where they are, metres; the largest of the three. Far below a metre on a map of some kilometres in EPSG:4326 or
/// EPSG:3857; on a grid that is turned from north by its meridian convergence, such as UTM's, 1.4 times the map's side times the sine of
/// that angle.
pub(crate) fn corner_error_m(georeference: &Georeference, size_px: (u64, u64)) -> Result<f64> {
    let (width, height) = (size_px.0 as f64, size_px.1 as f64);
    let at = |x: f64, y: f64| georeference.lonlat_from_map_px(MapPx::new(x, y));
    let (ll, ur) = (at(0.0, height)?, at(width, 0.0)?);
    let middle = LonLat::new(
        (ll.lon_deg + ur.lon_deg) / 2.0,
        (ll.lat_deg + ur.lat_deg) / 2.0,
    );
    let off_m = [
        distance_m(at(0.0, 0.0)?, LonLat::new(ll.lon_deg, ur.lat_deg)),
        distance_m(at(width, height)?, LonLat::new(ur.lon_deg, ll.lat_deg)),
        distance_m(at(width / 2.0, height / 2.0)?, middle),
    ];
    Ok(off_m.into_iter().fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use grimnet_geo::{Affine, Crs};

    use super::*;

    fn error_m(crs: &str, [left, top]: [f64; 2], px: f64, side_px: u64) -> f64 {
        let affine = Affine::from_gdal([left, px, 0.0, top, 0.0, -px]).unwrap();
        let size_px = (side_px, side_px);
        let map = Georeference::new(affine, Crs::parse(crs).unwrap(), size_px);
        corner_error_m(&map, size_px).unwrap()
    }

    /// The figures are pyproj's (PROJ), with distances by its `Geod`.
    #[test]
    fn a_grid_turned_from_north_costs_metres_and_web_mercator_none() {
        // 700 m in Berlin: UTM's north is 1.3 degrees off the meridian.
        let turned = error_m("EPSG:32633", [391_000.0, 5_818_000.0], 0.7, 1000);
        assert!((turned - 21.98).abs() < 0.01, "{turned}");
        let central = error_m("EPSG:32633", [499_650.0, 5_818_000.0], 0.7, 1000);
        assert!((central - 0.05).abs() < 0.01, "{central}");
        let mercator = error_m("EPSG:3857", [1_491_000.0, 6_890_000.0], 1.0, 8000);
        assert!((mercator - 0.606).abs() < 0.01, "{mercator}");
        // The upper right corner lies west of the lower left one in degrees.
        let antimeridian = error_m("EPSG:32660", [828_000.0, 110_000.0], 10.0, 1000);
        assert!(antimeridian > 1e5, "{antimeridian}");
    }
}
