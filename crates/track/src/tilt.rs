//! From the aircraft to the ground point at the photo's centre.

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::attitude::Attitude;

/// A view further off the vertical than this gives no offset: a small error of attitude or height is then tens of metres.
const LARGEST_TILT_COS: f64 = 0.5;

/// Where a camera that looks down sees its image centre, relative to the point below the aircraft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CentreOffset {
    /// Metres east and north of the point below the aircraft.
    pub offset_en_m: Vector2<f64>,
    /// Metres for one radian of boresight: columns are a tilt of the view forward and to the right in the camera's frame.
    pub by_boresight_m: Matrix2<f64>,
    /// Metres for one radian by which the view is tilted to the east and to the north.
    pub by_tilt_m: Matrix2<f64>,
}

impl CentreOffset {
    /// The offset over flat ground.
    ///
    /// The optical axis in north-east-down is `R(yaw, pitch, roll) (forward, right, 1)` with the boresight's two small angles;
    /// it is lengthened until it reaches the ground, `height_agl_m` below. `None` if the attitude is more than 60 degrees off the
    /// vertical, whatever the boresight.
    pub fn new(
        attitude: &Attitude,
        boresight_rad: Vector2<f64>,
        height_agl_m: f64,
    ) -> Option<Self> {
        let rotation = attitude.rotation();
        if rotation[(2, 2)] < LARGEST_TILT_COS {
            return None;
        }
        let axis_ned = rotation * Vector3::new(boresight_rad.x, boresight_rad.y, 1.0);
        let on_ground_m = |v: Vector3<f64>| {
            // Derivative of (east, north) / down along v.
            let lateral = Vector2::new(v.y, v.x);
            let axis = Vector2::new(axis_ned.y, axis_ned.x);
            (lateral * axis_ned.z - axis * v.z) * (height_agl_m / (axis_ned.z * axis_ned.z))
        };
        let by_boresight_m = Matrix2::from_columns(&[
            on_ground_m(rotation * Vector3::x()),
            on_ground_m(rotation * Vector3::y()),
        ]);
        // A tilt to the east by a radian has components forward and right in the camera's frame by its yaw.
        let (sin, cos) = attitude.yaw_deg.to_radians().sin_cos();
        let camera_from_en = Matrix2::new(sin, cos, cos, -sin);
        Some(Self {
            offset_en_m: Vector2::new(axis_ned.y, axis_ned.x) * (height_agl_m / axis_ned.z),
            by_boresight_m,
            by_tilt_m: by_boresight_m * camera_from_en,
        })
    }
}

impl Attitude {
    /// Where a camera with this attitude sees its image centre: metres east and north of the point below it, over flat ground that is
    /// `height_agl_m` below. `None` if the view is more than 60 degrees off the vertical.
    pub fn centre_offset_en_m(&self, height_agl_m: f64) -> Option<[f64; 2]> {
        let centre = CentreOffset::new(self, Vector2::zeros(), height_agl_m)?;
        Some(centre.offset_en_m.into())
    }

    /// Bearing of the photo's top, at its centre on the ground, degrees clockwise from true north: what a fix gives as its heading.
    pub fn top_deg(&self) -> f64 {
        (self.yaw_deg + top_from_yaw_deg(self)).rem_euclid(360.0)
    }
}

/// Ground resolution at the photo's centre over that straight below a camera at the same height. A photo's pixel there covers a
/// cone that meets the ground `1 / cos` as far away and at an angle: `1 / cos^3` the area. It is bounded near the horizon.
pub(crate) fn gsd_over_nadir(attitude: &Attitude) -> f64 {
    let cos = attitude.pitch_deg.to_radians().cos() * attitude.roll_deg.to_radians().cos();
    cos.max(LARGEST_TILT_COS).powf(-1.5)
}

/// Bearing of the photo's top, at its centre on the ground, from the attitude's yaw, degrees clockwise: the ground is sheared where the
/// view is tilted to the side as well as ahead.
pub(crate) fn top_from_yaw_deg(attitude: &Attitude) -> f64 {
    let sin_pitch = attitude.pitch_deg.to_radians().sin();
    let tan_roll = attitude.roll_deg.to_radians().tan();
    (-sin_pitch * tan_roll).atan().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn attitude(yaw_deg: f64, pitch_deg: f64, roll_deg: f64) -> Attitude {
        Attitude {
            time_s: 0.0,
            yaw_deg,
            pitch_deg,
            roll_deg,
        }
    }

    #[test]
    fn nose_up_looks_ahead_and_right_side_down_looks_left() {
        let none = Vector2::zeros();
        let ahead = CentreOffset::new(&attitude(90.0, 9.0, 0.0), none, 120.0).unwrap();
        assert_relative_eq!(
            ahead.offset_en_m,
            Vector2::new(120.0 * 9f64.to_radians().tan(), 0.0),
            epsilon = 1e-9
        );
        let left = CentreOffset::new(&attitude(0.0, 0.0, 27.0), none, 100.0).unwrap();
        assert_relative_eq!(
            left.offset_en_m,
            Vector2::new(-100.0 * 27f64.to_radians().tan(), 0.0),
            epsilon = 1e-9
        );
        assert!(CentreOffset::new(&attitude(0.0, 65.0, 0.0), none, 100.0).is_none());
    }

    #[test]
    fn a_gimbal_that_looks_ahead_of_straight_down() {
        let gimbal = Attitude::from_gimbal(0.0, 0.0, -81.0, 0.0);
        let ahead = CentreOffset::new(&gimbal, Vector2::zeros(), 120.0).unwrap();
        assert_relative_eq!(
            ahead.offset_en_m.y,
            120.0 * 9f64.to_radians().tan(),
            epsilon = 1e-9
        );
    }

    #[test]
    fn ground_resolution_falls_with_tilt() {
        // Half a degree to each side of a view tilted by 20 degrees, on the ground, and across it.
        let at = |deg: f64| deg.to_radians().tan();
        let along = (at(20.5) - at(19.5)) / (at(0.5) - at(-0.5));
        let across = 1.0 / 20f64.to_radians().cos();
        let expected = (along * across).sqrt();
        let tilted = gsd_over_nadir(&attitude(30.0, 0.0, 20.0));
        assert_relative_eq!(tilted, expected, max_relative = 1e-4);
        assert_relative_eq!(
            gsd_over_nadir(&attitude(0.0, 20.0, 0.0)),
            tilted,
            epsilon = 1e-12
        );
    }

    #[test]
    fn the_top_is_where_the_view_moves_that_leans_forward() {
        for (pitch_deg, roll_deg) in [(8.0, -20.0), (-6.0, 12.0), (30.0, 15.0), (20.0, 0.0)] {
            let attitude = attitude(0.0, pitch_deg, roll_deg);
            let centre = CentreOffset::new(&attitude, Vector2::zeros(), 150.0).unwrap();
            let [east_m, north_m] = [0, 1].map(|axis| centre.by_boresight_m[(axis, 0)]);
            assert_relative_eq!(
                attitude.top_deg(),
                east_m.atan2(north_m).to_degrees().rem_euclid(360.0),
                epsilon = 1e-9
            );
        }
    }

    #[test]
    fn derivatives_are_differences() {
        let at = |forward: f64, right: f64| {
            CentreOffset::new(
                &attitude(35.0, 8.0, -20.0),
                Vector2::new(0.02 + forward, -0.01 + right),
                150.0,
            )
            .unwrap()
        };
        let here = at(0.0, 0.0);
        let step = 1e-6;
        let by_forward = (at(step, 0.0).offset_en_m - at(-step, 0.0).offset_en_m) / (2.0 * step);
        let by_right = (at(0.0, step).offset_en_m - at(0.0, -step).offset_en_m) / (2.0 * step);
        assert_relative_eq!(
            here.by_boresight_m,
            Matrix2::from_columns(&[by_forward, by_right]),
            max_relative = 1e-6
        );
        // Level flight: a tilt of the view to the east moves the centre to the east by the height for each radian.
        let level = CentreOffset::new(&attitude(70.0, 0.0, 0.0), Vector2::zeros(), 150.0).unwrap();
        assert_relative_eq!(level.by_tilt_m, Matrix2::identity() * 150.0, epsilon = 1e-9);
    }
}
