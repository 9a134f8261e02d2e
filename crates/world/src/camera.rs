//! Pose, camera and the exact mapping between photo pixels and the ground.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Position and attitude of the camera in the world frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// East of the world's south-west corner, metres.
    pub x_m: f64,
    /// North of the world's south-west corner, metres.
    pub y_m: f64,
    /// Above the ground, metres.
    pub height_agl_m: f64,
    /// Direction of the top of the photo, degrees clockwise from grid north.
    pub heading_deg: f64,
    /// Tilt of the optical axis from straight down towards the heading, degrees.
    pub pitch_off_nadir_deg: f64,
    /// Tilt of the optical axis to the right of the heading, degrees.
    pub roll_deg: f64,
}

impl Default for Pose {
    /// 120 m above the origin, straight down, north up.
    fn default() -> Self {
        Self {
            x_m: 0.0,
            y_m: 0.0,
            height_agl_m: 120.0,
            heading_deg: 0.0,
            pitch_off_nadir_deg: 0.0,
            roll_deg: 0.0,
        }
    }
}

/// A pinhole camera with square pixels and the principal point in the middle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Horizontal field of view, degrees.
    pub hfov_deg: f64,
    /// Picture width.
    pub width_px: u32,
    /// Picture height.
    pub height_px: u32,
}

impl Camera {
    /// Focal length in pixels.
    pub fn focal_px(&self) -> f64 {
        f64::from(self.width_px) * 0.5 / (self.hfov_deg.to_radians() * 0.5).tan()
    }

    /// Focal length with the same horizontal field of view on film 36 mm wide (EXIF `FocalLengthIn35mmFilm`).
    pub fn focal_35mm(&self) -> f64 {
        18.0 / (self.hfov_deg.to_radians() * 0.5).tan()
    }
}

/// The projection of a camera at a pose. Photo pixels are continuous: (0, 0) is the outer corner of
/// the top-left pixel, the middle of the picture is (width / 2, height / 2).
#[derive(Clone, Copy, Debug)]
pub struct View {
    position: Vector3<f64>,
    /// Columns: photo right, photo down, optical axis, in world axes.
    world_from_camera: Matrix3<f64>,
    focal_px: f64,
    centre_px: [f64; 2],
}

impl View {
    /// The view of `camera` at `pose`.
    pub fn new(pose: &Pose, camera: &Camera) -> Self {
        let (sin_h, cos_h) = pose.heading_deg.to_radians().sin_cos();
        let (sin_p, cos_p) = pose.pitch_off_nadir_deg.to_radians().sin_cos();
        let (sin_r, cos_r) = pose.roll_deg.to_radians().sin_cos();
        let ahead = Vector3::new(sin_h, cos_h, 0.0);
        let right_level = Vector3::new(cos_h, -sin_h, 0.0);
        let nadir = -Vector3::z();
        let axis_pitched = nadir * cos_p + ahead * sin_p;
        let up = ahead * cos_p - nadir * sin_p;
        let axis = axis_pitched * cos_r + right_level * sin_r;
        let right = right_level * cos_r - axis_pitched * sin_r;
        Self {
            position: Vector3::new(pose.x_m, pose.y_m, pose.height_agl_m),
            world_from_camera: Matrix3::from_columns(&[right, -up, axis]),
            focal_px: camera.focal_px(),
            centre_px: [
                f64::from(camera.width_px) * 0.5,
                f64::from(camera.height_px) * 0.5,
            ],
        }
    }

    /// Camera position in the world, metres.
    pub fn position_m(&self) -> [f64; 3] {
        self.position.into()
    }

    /// Direction (not normalised) in world axes of the ray through a photo pixel.
    pub fn ray(&self, photo_px: [f64; 2]) -> [f64; 3] {
        (self.world_from_camera
            * Vector3::new(
                (photo_px[0] - self.centre_px[0]) / self.focal_px,
                (photo_px[1] - self.centre_px[1]) / self.focal_px,
                1.0,
            ))
        .into()
    }

    /// The photo pixel of a world point (metres, z above ground), which may be outside the picture;
    /// `None` if the point is behind the camera.
    pub fn photo_px_from_world(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let c = self.world_from_camera.transpose() * (Vector3::from(point_m) - self.position);
        (c.z > 1e-9).then(|| {
            [
                self.centre_px[0] + self.focal_px * c.x / c.z,
                self.centre_px[1] + self.focal_px * c.y / c.z,
            ]
        })
    }

    /// The photo pixel of a ground point (z = 0); `None` if it is behind the camera.
    pub fn photo_px_from_ground(&self, ground_m: [f64; 2]) -> Option<[f64; 2]> {
        self.photo_px_from_world([ground_m[0], ground_m[1], 0.0])
    }

    /// The point of the plane `z = height_m` at a photo pixel; `None` if the pixel is above the horizon.
    pub fn plane_from_photo_px(&self, photo_px: [f64; 2], height_m: f64) -> Option<[f64; 2]> {
        let d = Vector3::from(self.ray(photo_px));
        let t = (height_m - self.position.z) / d.z;
        (t.is_finite() && t > 0.0).then(|| {
            let p = self.position + d * t;
            [p.x, p.y]
        })
    }

    /// Homography from photo pixels to metres on the ground plane z = 0 (homogeneous columns).
    pub fn ground_from_photo_homography(&self) -> Matrix3<f64> {
        let k_inverse = Matrix3::new(
            1.0 / self.focal_px,
            0.0,
            -self.centre_px[0] / self.focal_px,
            0.0,
            1.0 / self.focal_px,
            -self.centre_px[1] / self.focal_px,
            0.0,
            0.0,
            1.0,
        );
        let d = self.world_from_camera * k_inverse;
        let (c, h) = (self.position, self.position.z);
        // ground = c.xy + d.xy * (h / -d.z); homogeneous: [c.xy * -d.z + d.xy * h, -d.z]
        Matrix3::from_rows(&[
            d.row(0) * h - d.row(2) * c.x,
            d.row(1) * h - d.row(2) * c.y,
            -d.row(2),
        ])
    }

    /// The four corners of the picture on the ground, clockwise from the top left; `None` if a corner
    /// is above the horizon.
    pub fn footprint_m(&self) -> Option<[[f64; 2]; 4]> {
        let [w, h] = [self.centre_px[0] * 2.0, self.centre_px[1] * 2.0];
        let at = |x, y| self.plane_from_photo_px([x, y], 0.0);
        Some([at(0.0, 0.0)?, at(w, 0.0)?, at(w, h)?, at(0.0, h)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    const CAMERA: Camera = Camera {
        hfov_deg: 60.0,
        width_px: 400,
        height_px: 300,
    };

    #[test]
    fn heading_turns_the_top_of_the_photo() {
        let pose = Pose {
            x_m: 50.0,
            y_m: 80.0,
            heading_deg: 90.0,
            ..Pose::default()
        };
        let view = View::new(&pose, &CAMERA);
        // Heading east: what lies east is at the top, what lies south is at the right.
        let east = view.photo_px_from_ground([70.0, 80.0]).unwrap();
        assert_relative_eq!(east[0], 200.0, epsilon = 1e-9);
        assert!(east[1] < 150.0);
        let south = view.photo_px_from_ground([50.0, 60.0]).unwrap();
        assert!(south[0] > 200.0);
    }

    #[test]
    fn leaning_forward_looks_ahead_and_rolling_looks_right() {
        let pitched = Pose {
            pitch_off_nadir_deg: 10.0,
            ..Pose::default()
        };
        let at = View::new(&pitched, &CAMERA)
            .plane_from_photo_px([200.0, 150.0], 0.0)
            .unwrap();
        assert_relative_eq!(at[1], 120.0 * 10.0_f64.to_radians().tan(), epsilon = 1e-9);
        let rolled = Pose {
            roll_deg: 5.0,
            ..Pose::default()
        };
        let at = View::new(&rolled, &CAMERA)
            .plane_from_photo_px([200.0, 150.0], 0.0)
            .unwrap();
        assert_relative_eq!(at[0], 120.0 * 5.0_f64.to_radians().tan(), epsilon = 1e-9);
    }

    #[test]
    fn homography_and_projection_agree() {
        let pose = Pose {
            x_m: 31.0,
            y_m: -7.0,
            height_agl_m: 105.0,
            heading_deg: 213.0,
            pitch_off_nadir_deg: 4.0,
            roll_deg: -3.0,
        };
        let view = View::new(&pose, &CAMERA);
        let h = view.ground_from_photo_homography();
        for px in [[0.0, 0.0], [399.5, 12.0], [200.0, 299.0]] {
            let g = h * Vector3::new(px[0], px[1], 1.0);
            let ground = [g.x / g.z, g.y / g.z];
            let direct = view.plane_from_photo_px(px, 0.0).unwrap();
            assert_relative_eq!(ground[0], direct[0], epsilon = 1e-8);
            assert_relative_eq!(ground[1], direct[1], epsilon = 1e-8);
            let back = view.photo_px_from_ground(ground).unwrap();
            assert_relative_eq!(back[0], px[0], epsilon = 1e-7);
            assert_relative_eq!(back[1], px[1], epsilon = 1e-7);
        }
    }

    #[test]
    fn height_moves_points_away_from_the_centre() {
        let view = View::new(&Pose::default(), &CAMERA);
        let foot = view.photo_px_from_world([20.0, 0.0, 0.0]).unwrap();
        let roof = view.photo_px_from_world([20.0, 0.0, 15.0]).unwrap();
        assert!(roof[0] > foot[0]);
    }
}
