//! Pictures of the world: orthophotos and perspective photos.

use image::RgbImage;
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::camera::{Camera, Pose, View};
use crate::look::Look;
use crate::sensor::{Development, Linear, LocalTones, halo_px, through_jpeg};
use crate::shade::{Light, Sample};
use crate::world::World;

type V3 = Vector3<f32>;

const TILE_PX: usize = 112;
/// Neighbourhood of the contrast equalisation: nodes this far apart, this many each way.
const TONE_STEP_M: f32 = 5.0;
const TONE_REACH: usize = 4;

/// A rectangle of the world, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegionM {
    /// West edge.
    pub x_min_m: f64,
    /// South edge.
    pub y_min_m: f64,
    /// West to east.
    pub width_m: f64,
    /// South to north.
    pub height_m: f64,
}

/// The georeference of a map picture: row 0 is the north edge, pixels are square.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapFrame {
    /// West edge, metres.
    pub x_min_m: f64,
    /// North edge, metres.
    pub y_max_m: f64,
    /// Metres per pixel.
    pub gsd_m: f64,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

impl MapFrame {
    /// The picture of [`World::render_map`] for `region`: the size is rounded to whole pixels, at least
    /// one, and the north-west corner is kept.
    pub fn new(region: RegionM, gsd_m: f64) -> Self {
        let count = |m: f64| (m / gsd_m).round().clamp(1.0, 100_000.0) as u32;
        Self {
            x_min_m: region.x_min_m,
            y_max_m: region.y_min_m + region.height_m,
            gsd_m,
            width_px: count(region.width_m),
            height_px: count(region.height_m),
        }
    }

    /// World metres at a continuous map pixel ((0, 0) is the outer corner of the top-left pixel).
    pub fn world_from_map_px(&self, map_px: [f64; 2]) -> [f64; 2] {
        [
            self.x_min_m + map_px[0] * self.gsd_m,
            self.y_max_m - map_px[1] * self.gsd_m,
        ]
    }

    /// Continuous map pixel of a world point on the ground.
    pub fn map_px_from_world(&self, world_m: [f64; 2]) -> [f64; 2] {
        [
            (world_m[0] - self.x_min_m) / self.gsd_m,
            (self.y_max_m - world_m[1]) / self.gsd_m,
        ]
    }
}

/// The ray (origin, downward direction) of a continuous picture position.
pub(crate) trait Rays: Sync {
    fn ray(&self, x: f32, y: f32) -> (V3, V3);
}

pub(crate) struct MapRays {
    x_min_m: f64,
    y_max_m: f64,
    gsd_m: f64,
    lean: [f32; 2],
    top_m: f32,
}

impl MapRays {
    pub(crate) fn new(frame: &MapFrame, lean: [f32; 2], top_m: f32) -> Self {
        Self {
            x_min_m: frame.x_min_m,
            y_max_m: frame.y_max_m,
            gsd_m: frame.gsd_m,
            lean,
            top_m,
        }
    }
}

impl Rays for MapRays {
    #[inline]
    fn ray(&self, x: f32, y: f32) -> (V3, V3) {
        let gx = (self.x_min_m + f64::from(x) * self.gsd_m) as f32;
        let gy = (self.y_max_m - f64::from(y) * self.gsd_m) as f32;
        let h = self.top_m;
        (
            V3::new(gx - self.lean[0] * h, gy - self.lean[1] * h, h),
            V3::new(self.lean[0], self.lean[1], -1.0),
        )
    }
}

pub(crate) struct PhotoRays {
    origin: V3,
    corner: V3,
    right: V3,
    down: V3,
}

impl PhotoRays {
    pub(crate) fn new(view: &View) -> Self {
        let ray = |px| Vector3::from(view.ray(px));
        let corner = ray([0.0, 0.0]);
        let f = |v: Vector3<f64>| v.map(|c| c as f32);
        Self {
            origin: f(Vector3::from(view.position_m())),
            corner: f(corner),
            right: f(ray([1.0, 0.0]) - corner),
            down: f(ray([0.0, 1.0]) - corner),
        }
    }
}

impl Rays for PhotoRays {
    #[inline]
    fn ray(&self, x: f32, y: f32) -> (V3, V3) {
        let mut d = self.corner + self.right * x + self.down * y;
        // Rays at or above the horizon see far ground instead.
        d.z = d.z.min(-0.05);
        (self.origin, d)
    }
}

struct Picture<'a, R> {
    world: &'a World,
    rays: R,
    look: &'a Look,
    light: Light,
    width: usize,
    height: usize,
    pixel_m: f32,
    /// Picture position of a node of the tone grid.
    tone_anchor_px: [f32; 2],
    noise_origin: [i32; 2],
}

impl<R: Rays> Picture<'_, R> {
    #[inline]
    fn sample(&self, x: f32, y: f32) -> Sample {
        let (o, d) = self.rays.ray(x, y);
        self.world
            .sample(o, d, self.look, &self.light, self.pixel_m)
    }

    /// One sample per pixel, four where neighbours belong to different surfaces.
    fn piece(&self, x0: i64, y0: i64, width: usize, height: usize) -> Linear {
        // One more row and column than asked for, to compare with.
        let (w, h) = (width + 1, height + 1);
        let mut samples = Vec::with_capacity(w * h);
        for y in 0..h {
            for x in 0..w {
                samples
                    .push(self.sample((x0 + x as i64) as f32 + 0.5, (y0 + y as i64) as f32 + 0.5));
            }
        }
        let differ = |a: &Sample, b: &Sample| {
            let (la, lb) = (a.rgb.luminance(), b.rgb.luminance());
            a.id != b.id && (la - lb).abs() > 0.02 + 0.08 * la.max(lb)
        };
        let mut rough = vec![false; w * h];
        for y in 0..h {
            for x in 0..w {
                let i = y * w + x;
                if x + 1 < w && differ(&samples[i], &samples[i + 1]) {
                    rough[i] = true;
                    rough[i + 1] = true;
                }
                if y + 1 < h && differ(&samples[i], &samples[i + w]) {
                    rough[i] = true;
                    rough[i + w] = true;
                }
            }
        }
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let i = y * w + x;
                let mut rgb = samples[i].rgb;
                if rough[i] {
                    for (dx, dy) in [(0.125, 0.375), (0.875, 0.25), (0.375, 0.875)] {
                        rgb += self
                            .sample((x0 + x as i64) as f32 + dx, (y0 + y as i64) as f32 + dy)
                            .rgb;
                    }
                    rgb = rgb * 0.25;
                }
                pixels.push(rgb);
            }
        }
        Linear {
            width,
            height,
            pixels,
        }
    }

    fn local_tones(&self, development: &Development<'_>) -> LocalTones {
        let step = (TONE_STEP_M / self.pixel_m).max(1.0);
        let before = |anchor: f32| (anchor / step).ceil() + TONE_REACH as f32 + 1.0;
        let origin = [
            self.tone_anchor_px[0] - before(self.tone_anchor_px[0]) * step,
            self.tone_anchor_px[1] - before(self.tone_anchor_px[1]) * step,
        ];
        let count =
            |size: usize, from: f32| ((size as f32 - from) / step).ceil() as usize + TONE_REACH + 2;
        let (w, h) = (count(self.width, origin[0]), count(self.height, origin[1]));
        let luminance: Vec<f32> = (0..h)
            .into_par_iter()
            .flat_map_iter(|y| {
                (0..w).map(move |x| {
                    let rgb = self
                        .sample(origin[0] + x as f32 * step, origin[1] + y as f32 * step)
                        .rgb;
                    development.plain_luminance(rgb)
                })
            })
            .collect();
        LocalTones::new(origin, step, w, h, &luminance, TONE_REACH)
    }

    fn render(&self) -> RgbImage {
        let sensor = &self.look.sensor;
        let mut development = Development {
            sensor,
            size_px: [self.width as f32, self.height as f32],
            noise_origin: self.noise_origin,
            noise_seed: self.look.epoch ^ 0x6e6f,
            tones: None,
        };
        if sensor.equalisation > 0.01 {
            development.tones = Some(self.local_tones(&development));
        }
        let halo = halo_px(sensor);
        let columns = self.width.div_ceil(TILE_PX);
        let rows = self.height.div_ceil(TILE_PX);
        let tiles: Vec<Vec<u8>> = (0..rows * columns)
            .into_par_iter()
            .map(|tile| {
                let (x0, y0) = (tile % columns * TILE_PX, tile / columns * TILE_PX);
                let (w, h) = (TILE_PX.min(self.width - x0), TILE_PX.min(self.height - y0));
                let linear = self
                    .piece(
                        x0 as i64 - halo as i64,
                        y0 as i64 - halo as i64,
                        w + 2 * halo,
                        h + 2 * halo,
                    )
                    .through_optics(sensor);
                let mut bytes = Vec::with_capacity(w * h * 3);
                for y in 0..h {
                    for x in 0..w {
                        let rgb = linear.pixels[(y + halo) * linear.width + x + halo];
                        bytes.extend(development.pixel((x0 + x) as u32, (y0 + y) as u32, rgb));
                    }
                }
                bytes
            })
            .collect();
        let mut picture = RgbImage::new(self.width as u32, self.height as u32);
        let stride = self.width * 3;
        let target: &mut [u8] = &mut picture;
        for (tile, bytes) in tiles.iter().enumerate() {
            let (x0, y0) = (tile % columns * TILE_PX, tile / columns * TILE_PX);
            let w = TILE_PX.min(self.width - x0) * 3;
            for (y, line) in bytes.chunks_exact(w).enumerate() {
                let at = (y0 + y) * stride + x0 * 3;
                target[at..at + w].copy_from_slice(line);
            }
        }
        match sensor.jpeg_quality {
            Some(quality) => through_jpeg(picture, quality),
            None => picture,
        }
    }
}

impl World {
    /// An orthophoto of `region` at `gsd_m` metres per pixel, north up (see [`MapFrame`]). Ground
    /// points are exactly where the frame says; objects above the ground are displaced by
    /// [`Look::lean_en`]. The result does not depend on the number of threads, and a crop equals the
    /// same part of the whole map, except for JPEG compression.
    pub fn render_map(&self, region: RegionM, gsd_m: f64, look: &Look) -> RgbImage {
        let frame = MapFrame::new(region, gsd_m);
        let pixel_m = gsd_m as f32;
        let picture = Picture {
            world: self,
            rays: MapRays::new(&frame, look.lean_en, self.objects.top_m + 1.0),
            look,
            light: Light::new(look),
            width: frame.width_px as usize,
            height: frame.height_px as usize,
            pixel_m,
            tone_anchor_px: [
                (-frame.x_min_m.rem_euclid(f64::from(TONE_STEP_M)) / gsd_m) as f32,
                (frame.y_max_m.rem_euclid(f64::from(TONE_STEP_M)) / gsd_m) as f32,
            ],
            noise_origin: [
                (frame.x_min_m / gsd_m).round() as i32,
                (-frame.y_max_m / gsd_m).round() as i32,
            ],
        };
        picture.render()
    }

    /// A photo by `camera` at `pose`. [`View`] is its exact projection. `look.lean_en` is not used.
    pub fn render_photo(&self, pose: &Pose, camera: &Camera, look: &Look) -> RgbImage {
        let view = View::new(pose, camera);
        let pixel_m = (pose.height_agl_m / camera.focal_px()) as f32;
        let picture = Picture {
            world: self,
            rays: PhotoRays::new(&view),
            look,
            light: Light::new(look),
            width: camera.width_px as usize,
            height: camera.height_px as usize,
            pixel_m,
            tone_anchor_px: [0.0, 0.0],
            noise_origin: [0, 0],
        };
        picture.render()
    }
}
