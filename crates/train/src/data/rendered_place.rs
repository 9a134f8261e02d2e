//! A place of a procedural world, rendered as a map and as a drone photo, with the height of the surface at each pixel.

use super::counterpart::Counterpart;
use super::picture::Picture;
use grimnet_world::{Camera, Look, MapFrame, Pose, RegionM, View, World};
use nalgebra::Matrix3;

/// Side of both pictures, pixels.
pub const RENDERED_PX: u32 = 400;
/// Two surface points are the same if they are nearer to each other than this, metres, plus one map pixel.
const SAME_SURFACE_M: f64 = 0.3;

/// Height of the surface above the ground at each pixel.
#[derive(Debug)]
struct Heights {
    /// Centimetres, row by row.
    values_cm: Vec<u16>,
    width: usize,
}

impl Heights {
    fn new(heights_m: &[f32], width: u32) -> Self {
        Self {
            values_cm: heights_m
                .iter()
                .map(|z| (z * 100.0).round() as u16)
                .collect(),
            width: width as usize,
        }
    }

    /// Height at the pixel nearest to a point (pixel centres at integers), metres; `None` outside.
    fn at_m(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
        if !(column >= 0.0 && row >= 0.0 && column < self.width as f64) {
            return None;
        }
        self.values_cm
            .get(row as usize * self.width + column as usize)
            .map(|cm| f64::from(*cm) / 100.0)
    }
}

/// A place of a procedural world, rendered twice from above.
#[derive(Debug)]
pub struct RenderedPlace {
    /// The map.
    pub sat: Picture,
    /// The photo.
    pub uav: Picture,
    sat_heights: Heights,
    uav_heights: Heights,
    frame: MapFrame,
    lean_en: [f64; 2],
    view: View,
}

impl RenderedPlace {
    /// Renders the map of a square around the point below the camera, and the photo.
    pub fn render(
        world: &World,
        gsd_m: f64,
        looks: [&Look; 2],
        pose: &Pose,
        camera: &Camera,
    ) -> Self {
        let side_m = gsd_m * f64::from(RENDERED_PX);
        let region = RegionM {
            x_min_m: pose.x_m - side_m / 2.0,
            y_min_m: pose.y_m - side_m / 2.0,
            width_m: side_m,
            height_m: side_m,
        };
        let frame = MapFrame::new(region, gsd_m);
        Self {
            sat: Picture::new(world.render_map(region, gsd_m, looks[0])),
            uav: Picture::new(world.render_photo(pose, camera, looks[1])),
            sat_heights: Heights::new(&world.map_heights_m(&frame, looks[0]), frame.width_px),
            uav_heights: Heights::new(
                &world.photo_heights_m(pose, camera, looks[1]),
                camera.width_px,
            ),
            frame,
            lean_en: looks[0].lean_en.map(f64::from),
            view: View::new(pose, camera),
        }
    }

    fn is_same_surface(&self, a: [f64; 3], b: [f64; 3]) -> bool {
        let square: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
        square.sqrt() < SAME_SURFACE_M + self.frame.gsd_m
    }

    /// The surface point at a map pixel, metres.
    fn map_surface(&self, at: [f64; 2]) -> Option<[f64; 3]> {
        let z = self.sat_heights.at_m(at)?;
        let [x, y] = self.frame.world_from_map_px(at.map(|v| v + 0.5));
        Some([x - self.lean_en[0] * z, y - self.lean_en[1] * z, z])
    }

    /// The surface point at a photo pixel, metres.
    fn photo_surface(&self, at: [f64; 2]) -> Option<[f64; 3]> {
        let z = self.uav_heights.at_m(at)?;
        let [x, y] = self.view.plane_from_photo_px(at.map(|v| v + 0.5), z)?;
        Some([x, y, z])
    }

    /// Where the photo shows the surface point at a map pixel (pixel centres at integers).
    pub fn uav_from_sat(&self, at: [f64; 2]) -> Counterpart {
        let Some(point) = self.map_surface(at) else {
            return Counterpart::Outside;
        };
        let Some(there) = self.view.photo_px_from_world(point) else {
            return Counterpart::Outside;
        };
        let there = there.map(|v| v - 0.5);
        match self.photo_surface(there) {
            None => Counterpart::Outside,
            Some(other) if self.is_same_surface(point, other) => Counterpart::At(there),
            Some(_) => Counterpart::Hidden,
        }
    }

    /// Where the map shows the surface point at a photo pixel (pixel centres at integers).
    pub fn sat_from_uav(&self, at: [f64; 2]) -> Counterpart {
        let Some(point) = self.photo_surface(at) else {
            return Counterpart::Outside;
        };
        let [x, y, z] = point;
        let ground = [x + self.lean_en[0] * z, y + self.lean_en[1] * z];
        let there = self.frame.map_px_from_world(ground).map(|v| v - 0.5);
        match self.map_surface(there) {
            None => Counterpart::Outside,
            Some(other) if self.is_same_surface(point, other) => Counterpart::At(there),
            Some(_) => Counterpart::Hidden,
        }
    }

    /// Homography from map pixels to photo pixels (centres at integers) of points on the ground; `None` if the camera looks
    /// along the ground.
    pub fn ground_homography(&self) -> Option<Matrix3<f64>> {
        let MapFrame {
            x_min_m,
            y_max_m,
            gsd_m,
            ..
        } = self.frame;
        let ground_from_map = Matrix3::new(
            gsd_m,
            0.0,
            x_min_m + 0.5 * gsd_m,
            0.0,
            -gsd_m,
            y_max_m - 0.5 * gsd_m,
            0.0,
            0.0,
            1.0,
        );
        let centre = Matrix3::new(1.0, 0.0, -0.5, 0.0, 1.0, -0.5, 0.0, 0.0, 1.0);
        let photo_from_ground = self.view.ground_from_photo_homography().try_inverse()?;
        Some(centre * photo_from_ground * ground_from_map)
    }

    /// West, south, east and north edge of the map picture, metres.
    pub fn bounds_m(&self) -> [f64; 4] {
        let f = &self.frame;
        let side_m = f64::from(f.height_px) * f.gsd_m;
        [
            f.x_min_m,
            f.y_max_m - side_m,
            f.x_min_m + f64::from(f.width_px) * f.gsd_m,
            f.y_max_m,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::super::homography::apply;
    use super::*;
    use grimnet_world::{Season, WorldConfig};

    #[test]
    fn ground_points_follow_the_homography_and_roofs_do_not() {
        let world = World::new(WorldConfig {
            seed: 3,
            size_m: 300.0,
            urban: 1.0,
            ..WorldConfig::default()
        });
        let looks = [Look::satellite(Season::Summer), Look::drone(Season::Summer)];
        let pose = Pose {
            x_m: 150.0,
            y_m: 140.0,
            height_agl_m: 100.0,
            pitch_off_nadir_deg: 4.0,
            ..Pose::default()
        };
        let camera = Camera {
            hfov_deg: 55.0,
            width_px: RENDERED_PX,
            height_px: RENDERED_PX,
        };
        let place = RenderedPlace::render(&world, 0.25, [&looks[0], &looks[1]], &pose, &camera);
        let ground = place.ground_homography().unwrap();
        let (mut on_ground, mut above, mut hidden) = (0, 0, 0);
        for y in (4..396).step_by(4) {
            for x in (4..396).step_by(4) {
                let at = [f64::from(x), f64::from(y)];
                let z = place.sat_heights.at_m(at).unwrap();
                match place.uav_from_sat(at) {
                    Counterpart::Hidden => hidden += 1,
                    Counterpart::Outside => {}
                    Counterpart::At(there) => {
                        let plain = apply(&ground, at);
                        let off = (plain[0] - there[0]).hypot(plain[1] - there[1]);
                        if z < 0.01 {
                            on_ground += 1;
                            assert!(off < 0.5, "{off}");
                        } else if z > 6.0 {
                            above += i32::from(off > 1.5);
                        }
                        let back = place.sat_from_uav(there);
                        if let Counterpart::At(back) = back {
                            assert!(
                                (back[0] - at[0]).hypot(back[1] - at[1]) < 2.5,
                                "{at:?} {back:?}"
                            );
                        }
                    }
                }
            }
        }
        assert!(
            on_ground > 1000 && above > 200 && hidden > 50,
            "{on_ground} {above} {hidden}"
        );
    }
}
