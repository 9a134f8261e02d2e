//! Pairs from procedural worlds: two renderings of one place that differ in season, sun, camera and time, with parallax, shadows
//! and exact correspondences.

use super::cuts::{cut_corners, random_turn};
use super::homography::random_homography;
use super::layout::Fold;
use super::mapping::Mapping;
use super::pair::{Keypoints, Pair, PairOptions, Place, Source, Views};
use super::photometric::Look;
use super::rendered_place::{RENDERED_PX, RenderedPlace};
use super::resample::warp;
use grimnet_world::{Camera, Look as WorldLook, Pose, World, WorldConfig};
use nalgebra::Matrix3;
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, OnceLock};

/// Number of worlds and of places in them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorldOptions {
    /// Number of worlds; each has its own plan, ground resolution, map look and photo look.
    pub worlds: usize,
    /// Places in each world. A place is rendered when it is first used and stays in memory: about 1.8 MB.
    pub places: usize,
}

impl Default for WorldOptions {
    fn default() -> Self {
        Self {
            worlds: 48,
            places: 12,
        }
    }
}

/// Side of a world, metres.
const WORLD_M: f64 = 560.0;
/// Range of the ground resolution of the maps, metres per pixel.
const GSD_M: [f64; 2] = [0.2, 0.55];
/// Picture indices of data folders stay below this number.
const FIRST_WORLD: usize = 1 << 40;
/// Random cuts of a place before another place is taken.
const TRIES: usize = 4;

/// A world with its map look, photo look and camera poses.
struct Scene {
    config: WorldConfig,
    gsd_m: f64,
    looks: [WorldLook; 2],
    poses: Vec<(Pose, Camera)>,
    world: OnceLock<World>,
    rendered: Vec<OnceLock<Arc<RenderedPlace>>>,
}

impl Scene {
    fn new(seed: u64, places: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let gsd_m = random.random_range(GSD_M[0].ln()..GSD_M[1].ln()).exp();
        let config = WorldConfig {
            seed,
            size_m: WORLD_M,
            urban: random.random_range(0.2..1.0),
            bend: random.random_range(0.0..1.0),
        };
        let poses = (0..places)
            .map(|_| random_pose(gsd_m, &mut random))
            .collect();
        Self {
            config,
            gsd_m,
            looks: [
                WorldLook::varied_satellite(seed),
                WorldLook::varied_drone(seed),
            ],
            poses,
            world: OnceLock::new(),
            rendered: (0..places).map(|_| OnceLock::new()).collect(),
        }
    }

    fn rendered_place(&self, index: usize) -> Arc<RenderedPlace> {
        self.rendered[index]
            .get_or_init(|| {
                let world = self.world.get_or_init(|| World::new(self.config));
                let (pose, camera) = &self.poses[index];
                let looks = [&self.looks[0], &self.looks[1]];
                Arc::new(RenderedPlace::render(
                    world, self.gsd_m, looks, pose, camera,
                ))
            })
            .clone()
    }
}

/// A nearly nadir camera at a random place, at the height from which it sees about the area of the rendered map.
fn random_pose(gsd_m: f64, random: &mut impl Rng) -> (Pose, Camera) {
    let side_m = gsd_m * f64::from(RENDERED_PX);
    let margin_m = side_m / 2.0;
    let hfov_deg: f64 = random.random_range(45.0..80.0);
    let footprint_m = side_m * random.random_range(0.9..1.15);
    let mut at = || random.random_range(margin_m..WORLD_M - margin_m);
    let pose = Pose {
        x_m: at(),
        y_m: at(),
        height_agl_m: footprint_m / 2.0 / (hfov_deg.to_radians() / 2.0).tan(),
        // Views are rotated when they are cut.
        heading_deg: 0.0,
        pitch_off_nadir_deg: random.random_range(-7.0..7.0),
        roll_deg: random.random_range(-4.0..4.0),
    };
    let camera = Camera {
        hfov_deg,
        width_px: RENDERED_PX,
        height_px: RENDERED_PX,
    };
    (pose, camera)
}

/// A set of worlds, decided by its seed.
pub struct Worlds {
    scenes: Vec<Scene>,
}

impl Worlds {
    /// Plans the worlds without rendering. The folds have no world in common.
    pub fn new(options: &WorldOptions, fold: Fold, seed: u64) -> Self {
        let first = seed.wrapping_mul(1_000_003)
            ^ match fold {
                Fold::Training => 0,
                Fold::Validation => 0x5eed_0000_0000,
            };
        Self {
            scenes: (0..options.worlds as u64)
                .map(|i| Scene::new(first.wrapping_add(i), options.places))
                .collect(),
        }
    }

    fn pair(
        &self,
        world: usize,
        place: usize,
        options: &PairOptions,
        random: &mut ChaCha8Rng,
    ) -> Option<Pair> {
        let rendered = self.scenes[world].rendered_place(place);
        let side = f64::from(options.side_px);
        let most = (f64::from(RENDERED_PX) * 0.95 / side).min(1.7);
        let scale = random.random_range(most.min(0.8)..=most);
        let free = (f64::from(RENDERED_PX) - side * scale).max(0.0);
        let corner = [
            random.random_range(0.0..=free),
            random.random_range(0.0..=free),
        ];
        let map_from_window = Matrix3::new(
            scale,
            0.0,
            corner[0] + 0.5 * scale - 0.5,
            0.0,
            scale,
            corner[1] + 0.5 * scale - 0.5,
            0.0,
            0.0,
            1.0,
        );
        let map_from_sat = map_from_window * random_turn(side, random);
        let uav_from_sat = random_homography(&options.homography, side, random);
        let photo_from_uav =
            rendered.ground_homography()? * map_from_sat * uav_from_sat.try_inverse()?;
        let (sat, sat_seen) = warp(&rendered.sat, &map_from_sat, options.side_px);
        if sat_seen.iter().any(|seen| !seen) {
            return None;
        }
        let (uav, mut seen) = warp(&rendered.uav, &photo_from_uav, options.side_px);
        if random.random_bool(options.black_corners) {
            cut_corners(&mut seen, options.side_px as usize, random);
        }
        let gsd_m = self.scenes[world].gsd_m;
        let [west, _, _, north] = rendered.bounds_m();
        let [left, top] = [west + corner[0] * gsd_m, -north + corner[1] * gsd_m];
        let side_m = side * scale * gsd_m;
        let mapping = Mapping::Relief {
            map_from_sat_px: [map_from_sat, map_from_sat.try_inverse()?],
            photo_from_uav_px: [photo_from_uav, photo_from_uav.try_inverse()?],
            place: rendered,
        };
        let place = Place {
            picture: FIRST_WORLD + world,
            window: [left, top, left + side_m, top + side_m],
        };
        // The renderings already differ in season, sun and shadows.
        let options = PairOptions {
            look: Look {
                sat_strength: options.look.sat_strength * 0.6,
                uav_strength: options.look.uav_strength * 0.5,
                shadows: 0.0,
                season: 0.0,
                ..options.look
            },
            ..options.clone()
        };
        Views {
            plain: [sat, uav],
            seen,
            uav_from_sat,
            mapping,
            place,
            scene: None,
            keypoints: Keypoints::Corners,
            other: None,
        }
        .finish(&options, random)
    }
}

impl Source for Worlds {
    /// Pairs of different places of one world under the same looks.
    fn group(&self, count: usize, options: &PairOptions, random: &mut ChaCha8Rng) -> Vec<Pair> {
        let mut out = Vec::with_capacity(count);
        if self.scenes.is_empty() {
            return out;
        }
        let world = random.random_range(0..self.scenes.len());
        let mut order: Vec<usize> = (0..self.scenes[world].poses.len()).collect();
        order.shuffle(random);
        for place in order {
            if out.len() == count {
                break;
            }
            out.extend((0..TRIES).find_map(|_| self.pair(world, place, options, random)));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_places_of_one_world_and_a_seed_decides_them() {
        let worlds = |fold| {
            Worlds::new(
                &WorldOptions {
                    worlds: 2,
                    places: 3,
                },
                fold,
                1,
            )
        };
        let options = PairOptions {
            side_px: 128,
            points: 60,
            ..PairOptions::default()
        };
        let group = |w: &Worlds| w.group(2, &options, &mut ChaCha8Rng::seed_from_u64(4));
        let (a, b) = (
            group(&worlds(Fold::Training)),
            group(&worlds(Fold::Training)),
        );
        assert_eq!(a.len(), 2);
        assert_eq!(a[0].sat, b[0].sat);
        assert_eq!(a[1].uav, b[1].uav);
        assert_eq!(a[0].place.picture, a[1].place.picture);
        for pair in &a {
            for (p, q) in pair.sat_points.iter().zip(&pair.uav_points) {
                let found = pair.mapping.uav_from_sat(p.map(f64::from), 128.0, 0.0);
                let [x, y] = found.at().unwrap();
                assert!((x - f64::from(q[0])).hypot(y - f64::from(q[1])) < 0.01);
            }
        }
        assert_ne!(group(&worlds(Fold::Validation))[0].sat, a[0].sat);
    }
}
