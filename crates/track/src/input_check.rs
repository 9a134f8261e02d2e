//! Which inputs are refused: every error names the field, its value and what was expected.

use grimnet_geo::LonLat;

use crate::error::InputError;
use crate::input::{HEIGHT_AGL_RANGE_M, Input, PositionFix};

impl Input {
    /// Checks that every number is finite and in its range.
    ///
    /// # Errors
    /// [`InputError::Invalid`] names the first field that is not.
    pub fn validate(&self) -> Result<(), InputError> {
        require("time_s", self.time_s(), self.time_s().is_finite(), "finite")?;
        match self {
            Self::Attitude(a) => {
                finite("yaw_deg", a.yaw_deg)?;
                finite("pitch_deg", a.pitch_deg)?;
                finite("roll_deg", a.roll_deg)
            }
            Self::Height(h) => {
                let possible = HEIGHT_AGL_RANGE_M.contains(&h.agl_m);
                require("agl_m", h.agl_m, possible, "in [1, 20000]")?;
                h.amsl_m.map_or(Ok(()), |value| finite("amsl_m", value))
            }
            Self::Velocity(v) => {
                finite("east_m_s", v.east_m_s)?;
                finite("north_m_s", v.north_m_s)?;
                positive("sigma_m_s", v.sigma_m_s)
            }
            Self::Motion(m) => {
                finite("from_time_s", m.from_time_s)?;
                finite("forward_px", m.forward_px)?;
                finite("right_px", m.right_px)?;
                finite("turn_deg", m.turn_deg)?;
                positive("sigma_px", m.sigma_px)?;
                if let Some(sigma_px) = m.surface_sigma_px {
                    let possible = sigma_px.is_finite() && sigma_px >= 0.0;
                    let expected = "finite and not negative";
                    require("surface_sigma_px", sigma_px, possible, expected)?;
                }
                let before = m.from_time_s < m.time_s;
                require("from_time_s", m.from_time_s, before, "before time_s")
            }
            Self::Fix(f) => validate_fix(f),
            Self::Miss(_) => Ok(()),
        }
    }
}

fn validate_fix(fix: &PositionFix) -> Result<(), InputError> {
    let LonLat { lon_deg, lat_deg } = fix.lonlat;
    let on_globe = (-90.0..=90.0).contains(&lat_deg);
    require("lat_deg", lat_deg, on_globe, "in [-90, 90]")?;
    let on_earth = (-360.0..=360.0).contains(&lon_deg);
    require("lon_deg", lon_deg, on_earth, "in [-360, 360]")?;
    let [ee, en, nn] = fix.covariance_en_m2;
    positive("covariance_en_m2[0]", ee)?;
    positive("covariance_en_m2[2]", nn)?;
    let definite = en.is_finite() && en * en < ee * nn;
    require("covariance_en_m2[1]", en, definite, "positive definite")?;
    let possible = fix.map_error_m.is_finite() && fix.map_error_m >= 0.0;
    require(
        "map_error_m",
        fix.map_error_m,
        possible,
        "finite and not negative",
    )?;
    if let Some(heading_deg) = fix.heading_deg {
        finite("heading_deg", heading_deg)?;
    }
    positive("gsd_m", fix.gsd_m)?;
    let probability = (0.0..=1.0).contains(&fix.confidence);
    require("confidence", fix.confidence, probability, "in [0, 1]")
}

fn finite(field: &'static str, value: f64) -> Result<(), InputError> {
    require(field, value, value.is_finite(), "finite")
}

fn positive(field: &'static str, value: f64) -> Result<(), InputError> {
    let possible = value.is_finite() && value > 0.0;
    require(field, value, possible, "finite and above 0")
}

fn require(
    field: &'static str,
    value: f64,
    holds: bool,
    expected: &'static str,
) -> Result<(), InputError> {
    if holds {
        Ok(())
    } else {
        Err(InputError::Invalid {
            field,
            value,
            expected,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{Height, tests::fix};

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let bad = [
            (
                "lat_deg",
                PositionFix {
                    lonlat: LonLat::new(0.0, 91.0),
                    ..fix()
                },
            ),
            (
                "lon_deg",
                PositionFix {
                    lonlat: LonLat::new(f64::NAN, 24.2),
                    ..fix()
                },
            ),
            (
                "covariance_en_m2[1]",
                PositionFix {
                    covariance_en_m2: [1.0, 2.0, 1.0],
                    ..fix()
                },
            ),
            (
                "covariance_en_m2[0]",
                PositionFix {
                    covariance_en_m2: [f64::NAN, 0.0, 1.0],
                    ..fix()
                },
            ),
            (
                "map_error_m",
                PositionFix {
                    map_error_m: -1.0,
                    ..fix()
                },
            ),
            (
                "heading_deg",
                PositionFix {
                    heading_deg: Some(f64::INFINITY),
                    ..fix()
                },
            ),
            (
                "gsd_m",
                PositionFix {
                    gsd_m: 0.0,
                    ..fix()
                },
            ),
            (
                "confidence",
                PositionFix {
                    confidence: 1.1,
                    ..fix()
                },
            ),
            (
                "time_s",
                PositionFix {
                    time_s: f64::NAN,
                    ..fix()
                },
            ),
        ];
        for (name, fix) in bad {
            match Input::Fix(fix).validate() {
                Err(InputError::Invalid { field, .. }) => assert_eq!(field, name),
                other => panic!("{name}: {other:?}"),
            }
        }
        assert!(Input::Fix(fix()).validate().is_ok());
    }

    #[test]
    fn heights_that_no_aircraft_has_are_refused() {
        let height = |agl_m| {
            Input::Height(Height {
                time_s: 0.0,
                agl_m,
                amsl_m: None,
            })
            .validate()
        };
        for agl_m in [f64::NAN, -3.0, 0.05, 65_535.0, 1e300] {
            let refused = height(agl_m).unwrap_err().to_string();
            assert!(refused.contains("agl_m"), "{refused}");
        }
        assert_eq!([1.0, 20_000.0].map(height), [Ok(()), Ok(())]);
    }
}
