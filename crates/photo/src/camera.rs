//! Camera model: field of view from focal lengths, and the projection of the ground plane by a tilted camera.

use nalgebra::Matrix3;
use serde::Serialize;

/// Diagonal of the 36 mm x 24 mm frame that "35 mm equivalent" focal lengths refer to, mm.
pub const FULL_FRAME_DIAGONAL_MM: f64 = 43.266_615_305_567_875;

/// Largest angle from nadir at which a photo is rectified, degrees.
pub const MAX_PITCH_FROM_NADIR_DEG: f64 = 75.0;

/// Ground farther away than this multiple of the distance to the picture's centre is cropped from a rectified photo,
/// because one pixel covers too much ground to match.
pub const MAX_DEPTH_RATIO: f64 = 2.5;

/// Tilt of the camera with the field of view that is needed to rectify it.
///
/// Angles follow the convention of drone metadata: the camera first points straight down with its top towards the yaw bearing,
/// then looks up (ahead) by `pitch_from_nadir_deg`, after turning about its optical axis by `roll_deg`
/// (right side down when it looks at the horizon).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tilt {
    /// Angle between the optical axis and straight down, degrees; positive looks ahead (DJI's gimbal pitch + 90).
    pub pitch_from_nadir_deg: f64,
    /// Turn about the optical axis, degrees.
    pub roll_deg: f64,
    /// Field of view across the picture's width, degrees.
    pub hfov_deg: f64,
}

impl Tilt {
    /// Bearing of the picture's top at its centre, relative to the gimbal's yaw, degrees clockwise.
    ///
    /// Straight down this is the roll; at other pitches the ground foreshortens it.
    pub fn top_from_yaw_deg(pitch_from_nadir_deg: f64, roll_deg: f64) -> f64 {
        let (sin_roll, cos_roll) = roll_deg.to_radians().sin_cos();
        let cos_pitch = pitch_from_nadir_deg.to_radians().cos();
        (sin_roll * cos_pitch).atan2(cos_roll).to_degrees()
    }

    /// Ground (metres right and *down the picture* of its top direction, relative to the ground at the picture's
    /// centre) from photo pixels relative to the picture's centre (x right, y down).
    ///
    /// `focal_px` in photo pixels, `distance_m` from the camera along the optical axis to the ground. The third
    /// homogeneous coordinate is positive for ground ahead of the camera, and the depth along the optical axis
    /// relative to the centre's is its reciprocal (it is 1 at the centre).
    pub fn ground_from_centred_px(&self, focal_px: f64, distance_m: f64) -> Matrix3<f64> {
        let (sin_pitch, cos_pitch) = self.pitch_from_nadir_deg.to_radians().sin_cos();
        let (sin_roll, cos_roll) = self.roll_deg.to_radians().sin_cos();
        let height_m = distance_m * cos_pitch;
        // Rays d = f forward + x right + y down meet the plane below; see the derivation in the tests' reference
        // implementation, which intersects rays one by one. Rows: to the right of the yaw bearing, along it, depth.
        let scale = 1.0 / (focal_px * cos_pitch);
        let right_ahead = Matrix3::new(
            height_m * cos_roll,
            -height_m * sin_roll,
            0.0,
            -height_m * sin_roll / cos_pitch,
            -height_m * cos_roll / cos_pitch,
            0.0,
            sin_pitch * sin_roll,
            sin_pitch * cos_roll,
            focal_px * cos_pitch,
        ) * scale;
        // From (right, ahead) of the yaw bearing to (right, down) of the picture's top.
        let (sin_top, cos_top) = Self::top_from_yaw_deg(self.pitch_from_nadir_deg, self.roll_deg)
            .to_radians()
            .sin_cos();
        let turn = Matrix3::new(
            cos_top, -sin_top, 0.0, -sin_top, -cos_top, 0.0, 0.0, 0.0, 1.0,
        );
        turn * right_ahead
    }
}

/// Field of view, degrees, across `side_px` of a picture with the given focal length in the same pixels.
///
/// ```
/// assert!((grimnet_photo::fov_deg(36.0, 18.0) - 90.0).abs() < 1e-12);
/// ```
pub fn fov_deg(side_px: f64, focal_px: f64) -> f64 {
    2.0 * (side_px / (2.0 * focal_px)).atan().to_degrees()
}

/// Focal length in pixels of a picture `side_px` wide with the given field of view.
pub fn focal_px(side_px: f64, fov_deg: f64) -> f64 {
    side_px / (2.0 * (fov_deg.to_radians() / 2.0).tan())
}

/// The shape of the sensor that a picture was taken with, before any crop to a wider format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum NativeFrame {
    /// 4:3, most small drones: 34.6 mm of the 43.3 mm diagonal.
    FourThirds,
    /// 3:2, such as the 1-inch sensors of 5472 px: 36 mm of the diagonal.
    ThreeHalves,
}

impl NativeFrame {
    /// The long side in the 35 mm frame of equal diagonal, mm.
    pub fn long_side_mm(self) -> f64 {
        match self {
            Self::FourThirds => FULL_FRAME_DIAGONAL_MM * 0.8,
            Self::ThreeHalves => 36.0,
        }
    }
}

/// A focal length in pixels, computed from a 35 mm equivalent.
#[derive(Debug, Clone, PartialEq)]
pub struct EquivalentFocal {
    /// Focal length in pixels of the full-size picture.
    pub focal_px: f64,
    /// Relative 1-sigma.
    pub relative_sigma: f64,
    /// Which convention and which crop were assumed.
    pub reading: String,
}

/// Focal length in pixels from the 35 mm equivalent of EXIF (tag 0xA405).
///
/// The equivalent compares *diagonals* of the sensor's native frame (CIPA DCG-001), not widths: a DJI Mini 2 of 24 mm
/// has 71.6 degrees across its 4:3 picture, not the 73.7 degrees of 2 atan(36 / 48). A 16:9 picture is the native
/// frame with rows cut off, its width kept, so the diagonal of the native frame counts and not its own.
/// `None` if the aspect ratio is neither of the two (panoramas, squares).
pub fn focal_px_from_35mm(focal_35mm: f64, full_size_px: (u32, u32)) -> Option<EquivalentFocal> {
    let long_px = f64::from(full_size_px.0.max(full_size_px.1));
    let short_px = f64::from(full_size_px.0.min(full_size_px.1));
    if !(focal_35mm.is_finite() && focal_35mm > 0.0 && short_px > 0.0) {
        return None;
    }
    let aspect = long_px / short_px;
    let near = |target: f64| (aspect / target - 1.0).abs() < 0.025;
    let (frame, relative_sigma, shape) = if near(4.0 / 3.0) {
        (NativeFrame::FourThirds, 0.03, "4:3 picture, whole frame")
    } else if near(1.5) {
        (NativeFrame::ThreeHalves, 0.03, "3:2 picture, whole frame")
    } else if (1.5..2.0).contains(&aspect) {
        // 1-inch sensors of 5472 px (and their half-size copies) are 3:2; the small ones are 4:3.
        if (long_px - 5472.0).abs() < 33.0 || (long_px - 2736.0).abs() < 17.0 {
            (
                NativeFrame::ThreeHalves,
                0.03,
                "wide picture, cropped from a 3:2 frame of the same width",
            )
        } else {
            (
                NativeFrame::FourThirds,
                0.05,
                "wide picture, assumed to be cropped from a 4:3 frame of the same width (4 % more if the frame is 3:2)",
            )
        }
    } else {
        return None;
    };
    Some(EquivalentFocal {
        focal_px: focal_35mm / frame.long_side_mm() * long_px,
        relative_sigma,
        reading: format!("35 mm equivalent by diagonals; {shape}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn hfov(focal_35mm: f64, size: (u32, u32)) -> f64 {
        let focal = focal_px_from_35mm(focal_35mm, size).unwrap();
        fov_deg(f64::from(size.0), focal.focal_px)
    }

    /// By hand: 2 atan(half the frame's side / focal length), the frame having a diagonal of 43.267 mm.
    #[test]
    fn fields_of_view_worked_out_by_hand() {
        // DJI Mini 2, 24 mm: 4:3 gives 34.613 mm across, 2 atan(17.307 / 24) = 71.59; its diagonal is 84.1, the
        // maker says 83.
        assert_relative_eq!(hfov(24.0, (4000, 3000)), 71.59, epsilon = 0.01);
        // The same camera at 16:9 keeps the width, not the diagonal.
        assert_relative_eq!(hfov(24.0, (4000, 2250)), 71.59, epsilon = 0.01);
        // Phantom 4 Pro, 24 mm, 3:2: 36 mm across, 2 atan(18 / 24) = 73.74; the maker says 84 over the diagonal.
        assert_relative_eq!(hfov(24.0, (5472, 3648)), 73.74, epsilon = 0.01);
        assert_relative_eq!(hfov(24.0, (5472, 3078)), 73.74, epsilon = 0.01);
        // Upright: the short side, 2 atan(12.98 / 24) = 56.8.
        assert_relative_eq!(hfov(24.0, (3000, 4000)), 56.81, epsilon = 0.01);
        // Its rows are 3 of 4: tan(56.81 / 2) / tan(71.59 / 2) = 0.75.
        assert_relative_eq!(
            (hfov(24.0, (3000, 4000)) / 2.0).to_radians().tan()
                / (hfov(24.0, (4000, 3000)) / 2.0).to_radians().tan(),
            0.75,
            epsilon = 1e-12
        );
    }

    #[test]
    fn other_shapes_say_nothing() {
        for size in [(4000, 4000), (8000, 2000), (0, 0), (4000, 0)] {
            assert_eq!(focal_px_from_35mm(24.0, size), None);
        }
        for focal in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(focal_px_from_35mm(focal, (4000, 3000)), None);
        }
    }

    #[test]
    fn focal_length_and_field_of_view_are_inverse() {
        for fov in [5.0, 71.6, 120.0] {
            assert_relative_eq!(fov_deg(4000.0, focal_px(4000.0, fov)), fov, epsilon = 1e-9);
        }
    }

    #[test]
    fn straight_down_the_roll_turns_the_top() {
        for roll in [-170.0, -20.0, 0.0, 35.0, 180.0] {
            assert_relative_eq!(Tilt::top_from_yaw_deg(0.0, roll), roll, epsilon = 1e-9);
        }
    }

    #[test]
    fn an_untilted_ground_is_a_scaled_picture() {
        let tilt = Tilt {
            pitch_from_nadir_deg: 0.0,
            roll_deg: 25.0,
            hfov_deg: 70.0,
        };
        let ground = tilt.ground_from_centred_px(1000.0, 50.0);
        let expected = Matrix3::new(0.05, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0);
        assert_relative_eq!(ground, expected, epsilon = 1e-12);
    }
}
