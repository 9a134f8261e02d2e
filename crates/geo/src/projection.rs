//! Projections by method and parameters, as PROJ strings.

/// Degrees within which an origin is a pole.
const AT_POLE_DEG: f64 = 1e-9;

/// A projection method that is read without an EPSG code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ProjectionMethod {
    TransverseMercator,
    Mercator,
    /// Lambert conformal conic with two standard parallels.
    LambertConformal2,
    /// Lambert conformal conic with one standard parallel, which is the origin's, and a scale.
    LambertConformal1,
    LambertAzimuthal,
    Albers,
    /// The latitude of the origin is a pole, or that of true scale.
    PolarStereographic,
    ObliqueStereographic,
    /// Hotine's, with the offsets at the centre of the projection (EPSG method 9815).
    ObliqueMercatorCentre,
    /// Hotine's, with the offsets at the natural origin (EPSG method 9812).
    ObliqueMercatorOrigin,
    /// Of Czechia and Slovakia, with axes to the east and north (EPSG method 1041).
    Krovak,
}

/// Parameters of a projection; angles in degrees.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ProjectionParameters {
    pub lat_0_deg: f64,
    pub lon_0_deg: f64,
    /// Standard parallels.
    pub lat_1_deg: Option<f64>,
    pub lat_2_deg: Option<f64>,
    /// Of the central line of an oblique projection, clockwise from north.
    pub azimuth_deg: Option<f64>,
    /// Of the central line from the grid's north; the azimuth where it is not stated.
    pub rectified_angle_deg: Option<f64>,
    pub scale: f64,
    pub false_easting_m: f64,
    pub false_northing_m: f64,
}

impl ProjectionMethod {
    /// The projection as a PROJ string without datum and units.
    ///
    /// # Errors
    /// Returns a description of what is missing.
    pub fn proj_string(self, parameters: &ProjectionParameters) -> Result<String, String> {
        let ProjectionParameters {
            lat_0_deg: lat_0,
            lon_0_deg: lon_0,
            lat_1_deg: lat_1,
            lat_2_deg: lat_2,
            azimuth_deg: azimuth,
            rectified_angle_deg: rectified_angle,
            scale: k,
            false_easting_m: x_0,
            false_northing_m: y_0,
        } = *parameters;
        let parallels = || match (lat_1, lat_2) {
            (Some(a), Some(b)) => Ok(format!("+lat_1={a} +lat_2={b}")),
            _ => Err("a conic projection without its parallels".to_string()),
        };
        let oblique = || {
            let alpha = azimuth.ok_or("an oblique Mercator projection without its azimuth")?;
            Ok::<_, String>((alpha, rectified_angle.unwrap_or(alpha)))
        };
        let offsets = format!("+lon_0={lon_0} +x_0={x_0} +y_0={y_0}");
        Ok(match self {
            Self::TransverseMercator => format!("+proj=tmerc +lat_0={lat_0} +k={k} {offsets}"),
            Self::Mercator => match lat_1 {
                Some(lat_ts) => format!("+proj=merc +lat_ts={lat_ts} {offsets}"),
                None => format!("+proj=merc +k={k} {offsets}"),
            },
            Self::LambertConformal2 => {
                format!("+proj=lcc {} +lat_0={lat_0} {offsets}", parallels()?)
            }
            Self::LambertConformal1 => {
                format!("+proj=lcc +lat_1={lat_0} +lat_0={lat_0} +k_0={k} {offsets}")
            }
            Self::LambertAzimuthal => format!("+proj=laea +lat_0={lat_0} {offsets}"),
            Self::Albers => format!("+proj=aea {} +lat_0={lat_0} {offsets}", parallels()?),
            Self::PolarStereographic => {
                let pole = if lat_0 < 0.0 { -90 } else { 90 };
                if (lat_0.abs() - 90.0).abs() < AT_POLE_DEG {
                    format!("+proj=stere +lat_0={pole} +k={k} {offsets}")
                } else {
                    format!("+proj=stere +lat_0={pole} +lat_ts={lat_0} {offsets}")
                }
            }
            Self::ObliqueStereographic => {
                format!("+proj=sterea +lat_0={lat_0} +k={k} {offsets}")
            }
            // Those of Switzerland and Hungary: `omerc` has no centre at a right angle.
            Self::ObliqueMercatorCentre if oblique()? == (90.0, 90.0) => {
                format!("+proj=somerc +lat_0={lat_0} +k_0={k} {offsets}")
            }
            Self::ObliqueMercatorCentre | Self::ObliqueMercatorOrigin => {
                let (alpha, gamma) = oblique()?;
                let at_origin = if self == Self::ObliqueMercatorOrigin {
                    " +no_uoff"
                } else {
                    ""
                };
                format!(
                    "+proj=omerc +lat_0={lat_0} +lonc={lon_0} +alpha={alpha} +gamma={gamma} +k={k} +x_0={x_0} +y_0={y_0}{at_origin}"
                )
            }
            Self::Krovak => format!("+proj=krovak +lat_0={lat_0} +k={k} {offsets}"),
        })
    }
}
