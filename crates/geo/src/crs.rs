//! Coordinate reference systems, to and from longitude and latitude on WGS 84.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use proj4rs::Proj;
use proj4rs::adaptors::transform_vertex_2d;
use serde::{Deserialize, Serialize};

use crate::datum_shifts::caveat_of;
use crate::epsg_definitions::proj_string_of_epsg;
use crate::metres::wrap_longitude_deg;
use crate::{GeoError, LonLat};

const WGS84: &str = "+proj=longlat +datum=WGS84 +no_defs";

/// Keys of PROJ strings that belong to the datum.
const DATUM_KEYS: [&str; 8] = [
    "+datum=",
    "+ellps=",
    "+towgs84=",
    "+a=",
    "+b=",
    "+rf=",
    "+pm=",
    "+nadgrids=",
];

static WGS84_PROJ: LazyLock<Option<Proj>> = LazyLock::new(|| Proj::from_proj_string(WGS84).ok());

/// A coordinate reference system. It is serialised as `EPSG:CODE` or as a PROJ string.
///
/// Definitions come from the EPSG registry (`crs-definitions`), transformations from `proj4rs`.
/// Datum shifts are those of the definition (`+towgs84`), good to some metres; a CRS whose shift is
/// a grid of corrections (NAD 27) is refused, one without any shift, or with a coarse one, has a [`Crs::caveat`].
#[derive(Clone)]
pub struct Crs {
    definition: String,
    proj_string: String,
    proj: Proj,
    /// Longitude and latitude on WGS 84 itself: nothing to compute.
    is_wgs84_lonlat: bool,
    caveat: Option<String>,
}

impl Crs {
    /// Longitude and latitude on WGS 84, in degrees (x is the longitude).
    ///
    /// # Errors
    /// None in practice.
    pub fn wgs84() -> Result<Self, GeoError> {
        Self::from_epsg(4326)
    }

    /// By EPSG code. x is always easting or longitude, y northing or latitude, as in GeoTIFF and
    /// world files, whatever the registry's axis order.
    ///
    /// # Errors
    /// Returns [`GeoError::UnknownCrs`] if the code is not in the list, or if its projection, unit or axes are not supported.
    pub fn from_epsg(code: u32) -> Result<Self, GeoError> {
        let definition = format!("EPSG:{code}");
        let proj_string = proj_string_of_epsg(code).map_err(|reason| GeoError::UnknownCrs {
            crs: definition.clone(),
            reason: reason.to_string(),
        })?;
        Self::from_parts(definition, &proj_string)
    }

    /// By PROJ string (`+proj=...`).
    ///
    /// # Errors
    /// Returns [`GeoError::UnknownCrs`] if it cannot be parsed or is not supported.
    pub fn from_proj_string(proj_string: &str) -> Result<Self, GeoError> {
        Self::from_parts(proj_string.to_string(), proj_string)
    }

    /// Parses `EPSG:32651`, `epsg:32651`, `32651`,
    /// `urn:ogc:def:crs:EPSG::32651`, `OGC:CRS84`, or a PROJ string.
    ///
    /// # Errors
    /// As [`Crs::from_epsg`] and [`Crs::from_proj_string`].
    pub fn parse(text: &str) -> Result<Self, GeoError> {
        let text = text.trim();
        if text.contains("+proj") {
            return Self::from_proj_string(text);
        }
        let upper = text.to_ascii_uppercase();
        if upper.ends_with("CRS84") {
            return Self::from_epsg(4326);
        }
        let digits = upper.rsplit(':').next().unwrap_or_default();
        let prefix = &upper[..upper.len() - digits.len()];
        let is_epsg = prefix.is_empty() || prefix.contains("EPSG");
        match digits.parse::<u32>() {
            Ok(code) if is_epsg => Self::from_epsg(code),
            _ => Err(GeoError::UnknownCrs {
                crs: text.to_string(),
                reason: "neither an EPSG code nor a PROJ string".to_string(),
            }),
        }
    }

    fn from_parts(definition: String, proj_string: &str) -> Result<Self, GeoError> {
        let unknown = |reason: String| GeoError::UnknownCrs {
            crs: definition.clone(),
            reason,
        };
        // The parser takes characters for bytes.
        if !proj_string.is_ascii() {
            return Err(unknown(
                "it has characters that are not ASCII; degrees and minutes are written 12d30'"
                    .to_string(),
            ));
        }
        let proj = Proj::from_proj_string(proj_string).map_err(|e| match e {
            proj4rs::errors::Error::NadGridNotAvailable => unknown(
                "its datum shift is a grid of corrections, which is not built in; reproject the \
                 map: gdalwarp -t_srs EPSG:4326 IN OUT"
                    .to_string(),
            ),
            other => unknown(other.to_string()),
        })?;
        if proj.is_geocent() {
            return Err(unknown(
                "geocentric coordinates cannot be those of a map".to_string(),
            ));
        }
        if !proj.has_inverse() || !proj.has_forward() {
            return Err(unknown("the projection has no inverse".to_string()));
        }
        let is_wgs84_lonlat = proj.is_latlong()
            && (proj_string.contains("+datum=WGS84") || proj_string.contains("+ellps=WGS84"))
            && !["+pm", "+towgs84", "+axis", "+nadgrids", "+geoc"]
                .iter()
                .any(|key| proj_string.contains(key));
        let caveat = caveat_of(proj_string);
        Ok(Self {
            definition,
            proj_string: proj_string.to_string(),
            proj,
            is_wgs84_lonlat,
            caveat,
        })
    }

    /// `EPSG:CODE` or the PROJ string; [`Crs::parse`] accepts it.
    pub fn definition(&self) -> &str {
        &self.definition
    }

    /// The PROJ string that is in use.
    pub fn proj_string(&self) -> &str {
        &self.proj_string
    }

    /// The parts of the PROJ string that say ellipsoid, prime meridian and shift to WGS 84: another projection may have them, too.
    pub(crate) fn datum(&self) -> String {
        let parts = self.proj_string.split_whitespace();
        let of_datum = |part: &&str| DATUM_KEYS.iter().any(|key| part.starts_with(key));
        parts.filter(of_datum).collect::<Vec<_>>().join(" ")
    }

    /// Whether coordinates are degrees of longitude and latitude.
    pub fn is_geographic(&self) -> bool {
        self.proj.is_latlong()
    }

    /// Semi-major and semi-minor axis of the ellipsoid, metres.
    pub(crate) fn axes_m(&self) -> (f64, f64) {
        self.proj.ellipse_parameters()
    }

    /// Metres per unit of projected coordinates.
    pub(crate) fn metres_per_unit(&self) -> f64 {
        self.proj.to_meter()
    }

    /// A warning about the accuracy, if there is a reason: without a datum shift to WGS 84 in the definition, positions
    /// can be off by hundreds of metres, with one of three parameters by tens.
    pub fn caveat(&self) -> Option<&str> {
        self.caveat.as_deref()
    }

    /// Period of x if coordinates repeat around the world: 360 degrees, or the equator's length in a Mercator projection.
    pub(crate) fn period_x(&self) -> Option<f64> {
        if self.is_geographic() {
            return Some(360.0);
        }
        let (a_m, _) = self.axes_m();
        matches!(self.proj.projname(), "merc" | "webmerc")
            .then(|| TAU * a_m * self.proj.scaling_factor() / self.proj.to_meter())
            .filter(|period| period.is_finite() && *period > 0.0)
    }

    /// Longitude and latitude of coordinates.
    ///
    /// # Errors
    /// Returns [`GeoError::OutsideDomain`] outside the domain of the projection.
    pub fn lonlat_from_xy(&self, x: f64, y: f64) -> Result<LonLat, GeoError> {
        if !x.is_finite() || !y.is_finite() {
            return Err(self.outside(x, y, "not finite"));
        }
        let lonlat = if self.is_wgs84_lonlat {
            LonLat::new(wrap_longitude_deg(x), y)
        } else {
            let wgs84 = WGS84_PROJ
                .as_ref()
                .ok_or_else(|| self.outside(x, y, "no WGS 84"))?;
            let point = if self.is_geographic() {
                (x.to_radians(), y.to_radians())
            } else {
                (x, y)
            };
            let (lon, lat) = transform_vertex_2d(&self.proj, wgs84, point)
                .map_err(|e| self.outside(x, y, &e.to_string()))?;
            LonLat::new(wrap_longitude_deg(lon.to_degrees()), lat.to_degrees())
        };
        if lonlat.is_valid() {
            Ok(lonlat)
        } else {
            Err(self.outside(x, y, "the result is not a latitude"))
        }
    }

    /// Coordinates of a longitude and latitude.
    ///
    /// # Errors
    /// Returns [`GeoError::OutsideDomain`] outside the domain of the projection.
    pub fn xy_from_lonlat(&self, place: LonLat) -> Result<(f64, f64), GeoError> {
        let (lon, lat) = (place.lon_deg, place.lat_deg);
        if !place.is_valid() {
            return Err(self.outside(lon, lat, "not a longitude and latitude"));
        }
        if self.is_wgs84_lonlat {
            return Ok((lon, lat));
        }
        let wgs84 = WGS84_PROJ
            .as_ref()
            .ok_or_else(|| self.outside(lon, lat, "no WGS 84"))?;
        let (x, y) = transform_vertex_2d(wgs84, &self.proj, (lon.to_radians(), lat.to_radians()))
            .map_err(|e| self.outside(lon, lat, &e.to_string()))?;
        let (x, y) = if self.is_geographic() {
            (x.to_degrees(), y.to_degrees())
        } else {
            (x, y)
        };
        if x.is_finite() && y.is_finite() {
            Ok((x, y))
        } else {
            Err(self.outside(lon, lat, "the result is not finite"))
        }
    }

    fn outside(&self, x: f64, y: f64, reason: &str) -> GeoError {
        GeoError::OutsideDomain {
            crs: self.definition.clone(),
            x,
            y,
            reason: reason.to_string(),
        }
    }
}

impl std::fmt::Debug for Crs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Crs({})", self.definition)
    }
}

impl std::fmt::Display for Crs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.definition)
    }
}

impl PartialEq for Crs {
    fn eq(&self, other: &Self) -> bool {
        self.proj_string == other.proj_string
    }
}

impl Serialize for Crs {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.definition)
    }
}

impl<'de> Deserialize<'de> for Crs {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::parse(&text).map_err(serde::de::Error::custom)
    }
}
