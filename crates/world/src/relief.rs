//! Height of the surface at each pixel of a picture.

use rayon::prelude::*;

use crate::camera::{Camera, Pose, View};
use crate::look::Look;
use crate::render::{MapFrame, MapRays, PhotoRays, Rays};
use crate::world::World;

impl World {
    /// Height above the ground of the surface at the centre of each pixel of [`World::render_map`],
    /// metres, row by row. A surface at height z is at the ground point of its pixel minus z times
    /// [`Look::lean_en`].
    pub fn map_heights_m(&self, frame: &MapFrame, look: &Look) -> Vec<f32> {
        let rays = MapRays::new(frame, look.lean_en, self.objects.top_m + 1.0);
        self.heights_m(&rays, frame.width_px, frame.height_px, look)
    }

    /// Height above the ground of the surface at the centre of each pixel of [`World::render_photo`],
    /// metres, row by row. [`View::plane_from_photo_px`] at that height gives its position.
    pub fn photo_heights_m(&self, pose: &Pose, camera: &Camera, look: &Look) -> Vec<f32> {
        let rays = PhotoRays::new(&View::new(pose, camera));
        self.heights_m(&rays, camera.width_px, camera.height_px, look)
    }

    fn heights_m(&self, rays: &impl Rays, width: u32, height: u32, look: &Look) -> Vec<f32> {
        (0..height)
            .into_par_iter()
            .flat_map_iter(|y| {
                (0..width).map(move |x| {
                    let (o, d) = rays.ray(x as f32 + 0.5, y as f32 + 0.5);
                    self.objects
                        .cast(o, d, look)
                        .map_or(0.0, |hit| (o.z + d.z * hit.t()).max(0.0))
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RegionM, Season, WorldConfig};

    /// A photo pixel, projected to the world by its height, has the same height in the map.
    #[test]
    fn photo_and_map_agree_on_what_stands_where() {
        let world = World::new(WorldConfig {
            seed: 5,
            size_m: 300.0,
            urban: 1.0,
            ..WorldConfig::default()
        });
        let mut map_look = Look::satellite(Season::Summer);
        let photo_look = Look {
            epoch: map_look.epoch,
            ..Look::drone(Season::Summer)
        };
        map_look.lean_en = [0.15, -0.1];
        let region = RegionM {
            x_min_m: 80.0,
            y_min_m: 90.0,
            width_m: 120.0,
            height_m: 110.0,
        };
        let frame = MapFrame::new(region, 0.5);
        let map = world.map_heights_m(&frame, &map_look);
        assert_eq!(map.len(), 240 * 220);
        let (pose, camera) = (
            Pose {
                x_m: 140.0,
                y_m: 145.0,
                height_agl_m: 90.0,
                heading_deg: 20.0,
                pitch_off_nadir_deg: 5.0,
                ..Pose::default()
            },
            Camera {
                hfov_deg: 50.0,
                width_px: 160,
                height_px: 120,
            },
        );
        let view = View::new(&pose, &camera);
        let photo = world.photo_heights_m(&pose, &camera, &photo_look);
        let (mut compared, mut same, mut raised) = (0, 0, 0);
        for y in 0..120u32 {
            for x in 0..160u32 {
                let z = f64::from(photo[(y * 160 + x) as usize]);
                let at = view
                    .plane_from_photo_px([f64::from(x) + 0.5, f64::from(y) + 0.5], z)
                    .unwrap();
                let ground = [
                    at[0] + f64::from(map_look.lean_en[0]) * z,
                    at[1] + f64::from(map_look.lean_en[1]) * z,
                ];
                let px = frame.map_px_from_world(ground);
                let (column, row) = (px[0].floor() as usize, px[1].floor() as usize);
                let there = f64::from(map[row * 240 + column]);
                compared += 1;
                raised += i32::from(z > 3.0);
                same += i32::from((there - z).abs() < 0.6);
            }
        }
        assert!(raised > 1000, "{raised} of {compared} raised");
        assert!(same * 10 > compared * 8, "{same} of {compared} agree");
    }
}
