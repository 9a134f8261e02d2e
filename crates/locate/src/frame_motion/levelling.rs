//! Keypoints as a camera sees them that looks straight down: with attitude and focal length the ray of a keypoint meets a level plane.

use nalgebra::{Point2, Rotation3, Vector3};

use crate::frame_features::FrameFeatures;

/// How a camera that looks down was tilted when it took a photo.
///
/// Rotations in the order pitch, roll about axes that turn with the camera, as in `Z-Y-X` Euler angles from north-east-down.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameTilt {
    /// Degrees, positive with the nose up: the camera then looks ahead, towards the photo's top.
    pub pitch_deg: f64,
    /// Degrees, positive with the right side down: the camera then looks to the left.
    pub roll_deg: f64,
}

/// Where points near the horizon are put, so that they agree with nothing.
pub(crate) const NOWHERE: Point2<f64> = Point2::new(1e9, 1e9);
/// A ray further off the vertical than this meets no ground that is near enough to match.
const LEAST_RAY_COS: f64 = 0.3;

/// The keypoints as a camera sees them that looks straight down, in units of `unit_px` pixels.
pub(crate) fn levelled_points(
    frame: &FrameFeatures,
    tilt: &FrameTilt,
    focal_length_px: f64,
    unit_px: f64,
) -> Vec<Point2<f64>> {
    let levelled = |point: &Point2<f64>| {
        levelled(*point, tilt, focal_length_px).map_or(NOWHERE, |point| point / unit_px)
    };
    frame.points_px.iter().map(levelled).collect()
}

/// A point of a photo (pixels from its centre, x right, y down) as a camera at the same place with the same focal length and heading
/// sees it that looks straight down. `None` near the horizon and above.
pub(crate) fn levelled(
    point_px: Point2<f64>,
    tilt: &FrameTilt,
    focal_length_px: f64,
) -> Option<Point2<f64>> {
    let rotation =
        Rotation3::from_euler_angles(tilt.roll_deg.to_radians(), tilt.pitch_deg.to_radians(), 0.0);
    // Forward, right, down.
    let ray = Vector3::new(-point_px.y, point_px.x, focal_length_px);
    let level = rotation * ray;
    (level.z > LEAST_RAY_COS * level.norm())
        .then(|| Point2::new(level.y, -level.x) * (focal_length_px / level.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_near_the_horizon_meet_no_ground() {
        let ahead = FrameTilt {
            pitch_deg: 60.0,
            roll_deg: 0.0,
        };
        assert!(levelled(Point2::new(0.0, -400.0), &ahead, 1000.0).is_none());
        assert!(levelled(Point2::new(0.0, 400.0), &ahead, 1000.0).is_some());
    }
}
