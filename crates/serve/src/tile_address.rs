//! Tiles of Web Mercator (EPSG:3857), numbered as XYZ: row 0 in the north.

use grimnet_geo::{LonLat, lonlat_from_web_mercator, web_mercator_from_lonlat};

/// Side of a tile, pixels.
pub(crate) const TILE_SIDE_PX: u32 = 256;

/// Finest zoom that is served.
pub(crate) const MAX_ZOOM: u32 = 24;

/// Metres per pixel of zoom 0 at the equator: 2 pi 6378137 / 256 (EPSG:3857).
const EQUATOR_M_PER_PX: f64 = 156_543.033_928_041;

/// How much coarser than `gsd_m` the pixels of a zoom may be, as a part of a zoom. The pixels of Web Mercator are those of a sphere,
/// and the resolution of a map is measured on the ellipsoid (EPSG:3857 on WGS 84): the two differ by up to 0.0097 of a zoom, which
/// is not to cost a whole one.
const ZOOM_TOLERANCE: f64 = 0.02;

/// One tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct TileAddress {
    z: u32,
    x: u32,
    y: u32,
}

impl TileAddress {
    /// The tile in column `x` and row `y` of zoom `z`; `None` if there is none.
    pub(crate) fn new(z: u32, x: u32, y: u32) -> Option<Self> {
        let exists = z <= MAX_ZOOM && x < 1 << z && y < 1 << z;
        exists.then_some(Self { z, x, y })
    }

    pub(crate) fn zoom(self) -> u32 {
        self.z
    }

    /// The tile of zoom `z` that holds a place; `None` where there is none. The last tiles hold the edge of the world too.
    pub(crate) fn at(z: u32, place: LonLat) -> Option<Self> {
        let [across, down] = web_mercator_from_lonlat(place);
        let tiles = f64::from(1_u32.checked_shl(z)?);
        let number = |share: f64| {
            let number = (share * tiles).floor().min(tiles - 1.0);
            (0.0..=1.0).contains(&share).then_some(number as u32)
        };
        Self::new(z, number(across)?, number(down)?)
    }

    /// The tiles of the rectangle from this one in the north-west to another of the same zoom, row by row.
    pub(crate) fn rectangle(self, to: Self) -> Vec<Self> {
        let rows = self.y..=to.y;
        rows.flat_map(|y| (self.x..=to.x).map(move |x| Self { z: self.z, x, y }))
            .collect()
    }

    /// A point of the tile, 0 to 1 from its top left corner, in the world from 0 to 1: x to the east, y to the south.
    pub(crate) fn world(self, right: f64, down: f64) -> [f64; 2] {
        let tiles = f64::from(1_u32 << self.z);
        [
            (f64::from(self.x) + right) / tiles,
            (f64::from(self.y) + down) / tiles,
        ]
    }

    /// Longitude and latitude of a point of the tile, pixels from its top left corner.
    pub(crate) fn lonlat(self, right_px: f64, down_px: f64) -> LonLat {
        let side_px = f64::from(TILE_SIDE_PX);
        lonlat_from_web_mercator(self.world(right_px / side_px, down_px / side_px))
    }
}

/// The zoom whose pixels are as fine as `gsd_m` at a latitude, or finer.
pub(crate) fn zoom_of_gsd(gsd_m: f64, lat_deg: f64) -> u32 {
    let zoom = (EQUATOR_M_PER_PX * lat_deg.to_radians().cos() / gsd_m).log2();
    let zoom = (zoom - ZOOM_TOLERANCE).ceil();
    if zoom.is_finite() {
        zoom.clamp(0.0, f64::from(MAX_ZOOM)) as u32
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_lie_where_openstreetmap_has_them() {
        // https://wiki.openstreetmap.org/wiki/Slippy_map_tilenames: the bounds of 10/511/340 (London).
        let tile = TileAddress::new(10, 511, 340).unwrap();
        let north_west = tile.lonlat(0.0, 0.0);
        assert!(
            (north_west.lon_deg - -0.3515625).abs() < 1e-9,
            "{north_west:?}"
        );
        assert!(
            (north_west.lat_deg - 51.618_016_548).abs() < 1e-6,
            "{north_west:?}"
        );
        let south_east = tile.lonlat(256.0, 256.0);
        let next = TileAddress::new(10, 512, 341).unwrap().lonlat(0.0, 0.0);
        assert_eq!(south_east, next);
        assert_eq!(TileAddress::at(10, tile.lonlat(9.0, 250.0)), Some(tile));
        let last = TileAddress::at(10, LonLat::new(180.0, 0.0)).unwrap();
        assert_eq!(last.world(1.0, 0.0), [1.0, 0.5]);
        assert_eq!(TileAddress::at(10, LonLat::new(181.0, 0.0)), None);
        assert_eq!(TileAddress::at(10, LonLat::new(0.0, 89.0)), None);
        let below = TileAddress::new(10, 512, 341).unwrap();
        assert_eq!(tile.rectangle(below).len(), 4);
    }

    #[test]
    fn only_tiles_that_exist() {
        assert!(TileAddress::new(0, 0, 0).is_some());
        for (z, x, y) in [
            (0, 1, 0),
            (3, 8, 0),
            (3, 0, 8),
            (25, 0, 0),
            (u32::MAX, 0, 0),
        ] {
            assert!(TileAddress::new(z, x, y).is_none());
        }
    }

    #[test]
    fn zooms_are_as_fine_as_the_map() {
        assert_eq!(zoom_of_gsd(156_543.033_928_041, 0.0), 0);
        assert_eq!(zoom_of_gsd(0.3, 0.0), 19);
        assert_eq!(zoom_of_gsd(0.3, 60.0), 18);
        assert_eq!(zoom_of_gsd(f64::NAN, 0.0), 0);
    }

    #[test]
    fn a_map_of_tiles_gets_the_zoom_of_its_tiles() {
        // Radii of curvature of WGS 84 over its semi-major axis (EPSG guidance note 7-2).
        let squared_eccentricity = 0.006_694_379_990_14_f64;
        for lat_deg in [0.0_f64, 24.0, 60.0] {
            let lat_rad = lat_deg.to_radians();
            let w2 = 1.0 - squared_eccentricity * lat_rad.sin().powi(2);
            let (east, north) = (w2.powf(-0.5), (1.0 - squared_eccentricity) * w2.powf(-1.5));
            for zoom in [1, 12, 19] {
                let on_sphere_m = EQUATOR_M_PER_PX * lat_rad.cos() / f64::from(1 << zoom);
                let gsd_m = on_sphere_m * east.min(north);
                assert_eq!(zoom_of_gsd(gsd_m, lat_deg), zoom, "{lat_deg}");
            }
        }
    }
}
