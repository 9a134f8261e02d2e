//! Geometries as a GeoPackage stores them (OGC 12-128r18, 2.1.3), in longitude and latitude.

use grimnet_geo::{LonLat, destination};

use crate::antimeridian::beside;

/// EPSG:4326, of all layers.
pub(crate) const SRS_ID: i32 = 4326;
/// Points of an ellipse.
const ELLIPSE_POINTS: usize = 64;
/// Radius of the circle that holds 95 % of a normal distribution in the plane, standard deviations: sqrt(-2 ln 0.05).
const SIGMAS_95: f64 = 2.447_746_830_680_816;

/// Numbers of well-known binary (OGC 06-103r4, table 7).
const WKB_POINT: u32 = 1;
const WKB_LINE: u32 = 2;
const WKB_POLYGON: u32 = 3;

/// A geometry of longitudes and latitudes, degrees.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Geometry {
    /// A point.
    Point([f64; 2]),
    /// A line of two points or more.
    Line(Vec<[f64; 2]>),
    /// A polygon of one ring, counter-clockwise, which is not closed here.
    Polygon(Vec<[f64; 2]>),
}

impl Geometry {
    /// Its corners.
    pub fn points(&self) -> &[[f64; 2]] {
        match self {
            Self::Point(point) => std::slice::from_ref(point),
            Self::Line(points) | Self::Polygon(points) => points,
        }
    }

    /// Header and well-known binary, little-endian.
    pub fn blob(&self) -> Vec<u8> {
        let points = self.points();
        match self {
            Self::Point(_) => {
                let mut blob = header(None);
                begin(&mut blob, WKB_POINT);
                extend(&mut blob, points.iter());
                blob
            }
            Self::Line(_) => {
                let mut blob = header(Bounds::of(points).0);
                begin(&mut blob, WKB_LINE);
                blob.extend((points.len() as u32).to_le_bytes());
                extend(&mut blob, points.iter());
                blob
            }
            Self::Polygon(_) => {
                let mut blob = header(Bounds::of(points).0);
                begin(&mut blob, WKB_POLYGON);
                blob.extend(1_u32.to_le_bytes());
                let closed = points.iter().chain(points.first());
                blob.extend((closed.clone().count() as u32).to_le_bytes());
                extend(&mut blob, closed);
                blob
            }
        }
    }

    /// The ellipse that holds 95 % of a normal distribution with this covariance (east-east, east-north, north-north, square
    /// metres), counter-clockwise, on the same side of the antimeridian as the centre.
    pub fn ellipse95([lon_deg, lat_deg]: [f64; 2], [east, both, north]: [f64; 3]) -> Self {
        let centre = LonLat::new(lon_deg, lat_deg);
        // The lower triangular root of the covariance turns a circle into the ellipse.
        let east_sigma = east.max(0.0).sqrt();
        let shared = if east_sigma > 0.0 {
            both / east_sigma
        } else {
            0.0
        };
        let rest = (north - shared * shared).max(0.0).sqrt();
        let points = (0..ELLIPSE_POINTS).map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / ELLIPSE_POINTS as f64;
            let (sin, cos) = angle.sin_cos();
            let east_m = SIGMAS_95 * east_sigma * cos;
            let north_m = SIGMAS_95 * (shared * cos + rest * sin);
            let bearing_deg = east_m.atan2(north_m).to_degrees();
            let point = destination(centre, bearing_deg, east_m.hypot(north_m));
            [beside(point.lon_deg, centre.lon_deg), point.lat_deg]
        });
        Self::Polygon(points.collect())
    }
}

/// Edges of what was written: west, south, east, north.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bounds(Option<[f64; 4]>);

impl Bounds {
    fn of(points: &[[f64; 2]]) -> Self {
        let mut bounds = Self::default();
        bounds.add(points);
        bounds
    }

    /// Takes in points.
    pub fn add(&mut self, points: &[[f64; 2]]) {
        for &[x, y] in points {
            let [west, south, east, north] = self.0.unwrap_or([x, y, x, y]);
            self.0 = Some([west.min(x), south.min(y), east.max(x), north.max(y)]);
        }
    }

    /// The edges; `None` each if there was nothing.
    pub fn edges(self) -> [Option<f64>; 4] {
        self.0.map_or([None; 4], |edges| edges.map(Some))
    }
}

/// The header of a geometry: with an envelope of x and y, or without.
fn header(bounds: Option<[f64; 4]>) -> Vec<u8> {
    let flags = if bounds.is_some() { 0b011 } else { 0b001 };
    let mut blob = vec![b'G', b'P', 0, flags];
    blob.extend(SRS_ID.to_le_bytes());
    if let Some([west, south, east, north]) = bounds {
        for number in [west, east, south, north] {
            blob.extend(number.to_le_bytes());
        }
    }
    blob
}

fn begin(blob: &mut Vec<u8>, kind: u32) {
    blob.push(1);
    blob.extend(kind.to_le_bytes());
}

fn extend<'a>(blob: &mut Vec<u8>, points: impl Iterator<Item = &'a [f64; 2]>) {
    blob.extend(points.flatten().flat_map(|v| v.to_le_bytes()));
}

#[cfg(test)]
mod tests {
    use grimnet_geo::offset_en_m;

    use super::*;

    #[test]
    fn an_ellipse_is_where_the_covariance_puts_it() {
        let centre = LonLat::new(179.999_99, -33.0);
        let [a, b, c] = [4.0, 1.2, 1.0];
        let ellipse = Geometry::ellipse95([centre.lon_deg, centre.lat_deg], [a, b, c]);
        for &[lon, lat] in ellipse.points() {
            assert!(lon > 179.0, "{lon}");
            let (e, n) = offset_en_m(centre, LonLat::new(lon, lat));
            // Mahalanobis distance of the edge: the chi-square quantile of two degrees of freedom, 5.991.
            let squared = (c * e * e - 2.0 * b * e * n + a * n * n) / (a * c - b * b);
            assert!((squared - 5.991_464_5).abs() < 1e-3, "{squared}");
        }
    }

    #[test]
    fn a_point_is_header_and_two_numbers() {
        let point = Geometry::Point([120.75, 24.25]).blob();
        assert_eq!(point.len(), 8 + 5 + 16);
        assert_eq!(point[..8], [b'G', b'P', 0, 1, 0xE6, 0x10, 0, 0]);
    }
}
