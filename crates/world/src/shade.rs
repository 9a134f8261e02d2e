//! Radiance of what a ray hits.

use nalgebra::{Vector2, Vector3};

use crate::colour::Rgb;
use crate::look::Look;
use crate::noise::fbm;
use crate::object_albedo::{solid_albedo, tree_albedo};
use crate::objects::{Hit, Skip};
use crate::random::hash2;
use crate::world::World;

type V2 = Vector2<f32>;
type V3 = Vector3<f32>;

/// Sun and sky of one picture, scaled so that flat white ground in the sun has radiance 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Light {
    pub(crate) to_sun: V3,
    sun: Rgb,
    sky: Rgb,
}

impl Light {
    pub(crate) fn new(look: &Look) -> Self {
        let elevation = look.sun_elevation_deg.clamp(10.0, 85.0).to_radians();
        let azimuth = look.sun_azimuth_deg.to_radians();
        let to_sun = V3::new(
            azimuth.sin() * elevation.cos(),
            azimuth.cos() * elevation.cos(),
            elevation.sin(),
        );
        let sky_share = look.sky_share.clamp(0.02, 0.98);
        Self {
            to_sun,
            sun: Rgb([1.02, 1.0, 0.95]) * ((1.0 - sky_share) / elevation.sin()),
            sky: Rgb([0.86, 0.99, 1.18]) * sky_share,
        }
    }

    #[inline]
    fn on(&self, normal: V3, visible: f32) -> Rgb {
        let facing = normal.dot(&self.to_sun).max(0.0) * visible;
        self.sun * facing + self.sky * (0.62 + 0.38 * normal.z)
    }
}

/// Radiance of a sample, and a number that tells apart the surfaces whose borders are antialiased.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    pub(crate) rgb: Rgb,
    pub(crate) id: u32,
}

impl World {
    /// Radiance along the downward ray `o + t d`; `pixel_m` is the size of a pixel on the ground.
    #[inline]
    pub(crate) fn sample(&self, o: V3, d: V3, look: &Look, light: &Light, pixel_m: f32) -> Sample {
        match self.objects.cast(o, d, look) {
            None => {
                let p = o - d * (o.z / d.z);
                let ground = self.ground.surface(V2::new(p.x, p.y), look.season, pixel_m);
                let above = V3::new(p.x, p.y, 0.01);
                let visible = self
                    .objects
                    .sunlight(above, light.to_sun, Skip::Nothing, look);
                Sample {
                    rgb: ground.albedo.times(light.on(V3::z(), visible)),
                    id: ground.id ^ if visible < 0.5 { 0x8000_0000 } else { 0 },
                }
            }
            Some(Hit::Solid { index, hit }) => {
                let solid = &self.objects.solids[index as usize];
                let p = o + d * hit.t;
                let albedo = solid_albedo(solid, &hit, p, look.season, pixel_m);
                let lit = hit.normal.dot(&light.to_sun) > 0.0;
                let visible = if lit {
                    let start = p + hit.normal * 0.02;
                    self.objects
                        .sunlight(start, light.to_sun, Skip::Solid(index), look)
                } else {
                    0.0
                };
                let id = hash2(index, u32::from(hit.face_index)) & 0x3fff_ffff;
                Sample {
                    rgb: albedo.times(light.on(hit.normal, visible)),
                    id: id ^ if visible < 0.5 { 0x8000_0000 } else { 0 },
                }
            }
            Some(Hit::Tree { index, hit }) => {
                let tree = &self.objects.trees[index as usize];
                let p = o + d * hit.t;
                let visible = self
                    .objects
                    .sunlight(p, light.to_sun, Skip::Tree(index), look);
                let leaves =
                    fbm(p.x * 27.0 + p.z * 5.0, p.y * 27.0 - p.z * 5.0) * (0.12 / pixel_m).min(1.0);
                let h = hit.clump.height;
                let open = (0.18 + 0.9 * h * h) * (1.0 + 0.45 * leaves);
                let lit = light.on(hit.normal, visible * (0.45 + 0.55 * hit.clump.height));
                Sample {
                    rgb: tree_albedo(tree, &hit, look.season).times(lit) * open,
                    id: 0x4000_0000 | index,
                }
            }
        }
    }
}
