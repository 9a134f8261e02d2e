//! The world: everything that stands and lies in it, ready to be looked at.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::bucket_grid::BucketGrid;
use crate::camera::View;
use crate::cast::Hit;
use crate::ground::Ground;
use crate::look::{Look, Season};
use crate::populate::populate;
use crate::random::Stream;
use crate::solid::Solid;
use crate::tree::Tree;

/// How far the world goes on beyond the map's edge, so that photos near it are whole.
pub(crate) const MARGIN_M: f32 = 160.0;

/// What kind of world to build.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldConfig {
    /// Same seed, same world.
    pub seed: u64,
    /// Side of the square map, metres; kept between 100 and 8000.
    pub size_m: f64,
    /// Share of the map that is town, 0-1; the rest is countryside.
    pub urban: f32,
    /// How much roads bend: 0 straight, 1 strongly.
    pub bend: f32,
}

impl Default for WorldConfig {
    /// 1.2 km, a little more than half of it town.
    fn default() -> Self {
        Self {
            seed: 1,
            size_m: 1200.0,
            urban: 0.55,
            bend: 0.5,
        }
    }
}

/// A procedural town and countryside. Frames are described at the crate's root.
#[derive(Debug)]
pub struct World {
    config: WorldConfig,
    pub(crate) ground: Ground,
    pub(crate) solids: Vec<Solid>,
    pub(crate) solid_grid: BucketGrid,
    pub(crate) trees: Vec<Tree>,
    pub(crate) tree_grid: BucketGrid,
    /// Highest thing touching each cell of the grids, and of all.
    pub(crate) cell_top_m: Vec<f32>,
    pub(crate) top_m: f32,
}

/// What a ray met first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// East, metres.
    pub x_m: f64,
    /// North, metres.
    pub y_m: f64,
    /// Above the ground, metres; 0 on it.
    pub height_m: f64,
}

impl World {
    /// Builds the world; takes about 0.2 s per square kilometre.
    pub fn new(config: WorldConfig) -> Self {
        let config = WorldConfig {
            size_m: if config.size_m.is_finite() {
                config.size_m.clamp(100.0, 8000.0)
            } else {
                1200.0
            },
            urban: config.urban.clamp(0.0, 1.0),
            bend: config.bend.clamp(0.0, 1.0),
            ..config
        };
        let (low, high) = (-MARGIN_M, config.size_m as f32 + MARGIN_M);
        let made = populate(&config, low, high, &mut Stream::new(config.seed));
        let solid_grid = BucketGrid::build(low, high, &made.solids);
        let tree_grid = BucketGrid::build(low, high, &made.trees);
        let cells = solid_grid.side() * solid_grid.side();
        let cell_top_m: Vec<f32> = (0..cells)
            .map(|c| {
                let solids = solid_grid
                    .in_cell(c)
                    .iter()
                    .map(|&i| made.solids[i as usize].top_m());
                let trees = tree_grid
                    .in_cell(c)
                    .iter()
                    .map(|&i| made.trees[i as usize].top_m);
                solids.chain(trees).fold(0.0, f32::max)
            })
            .collect();
        let top_m = cell_top_m.iter().copied().fold(0.0, f32::max);
        Self {
            config,
            ground: made.ground,
            solids: made.solids,
            solid_grid,
            trees: made.trees,
            tree_grid,
            cell_top_m,
            top_m,
        }
    }

    /// The configuration after clamping.
    pub fn config(&self) -> &WorldConfig {
        &self.config
    }

    /// Side of the square map, metres.
    pub fn size_m(&self) -> f64 {
        self.config.size_m
    }

    /// Numbers of solids (buildings, cars, walls) and trees.
    pub fn object_counts(&self) -> (usize, usize) {
        (self.solids.len(), self.trees.len())
    }

    /// Height of the highest surface above a ground point, metres, at the moment of `look`.
    pub fn height_at(&self, x_m: f64, y_m: f64, look: &Look) -> f64 {
        let o = Vector3::new(x_m as f32, y_m as f32, self.top_m + 10.0);
        match self.cast(o, -Vector3::z(), look) {
            Some(hit) => f64::from(o.z - hit.t()),
            None => 0.0,
        }
    }

    /// Display colour (0-255) of the bare ground at a point: roads, fields, water; without shadows.
    pub fn ground_colour(&self, x_m: f64, y_m: f64, season: Season) -> [u8; 3] {
        let p = Vector2::new(x_m as f32, y_m as f32);
        self.ground
            .surface(p, season, 0.2)
            .albedo
            .0
            .map(|v| (v.max(0.0).sqrt() * 255.0).min(255.0) as u8)
    }

    /// The surface (ground, roof, wall, crown) seen at a photo pixel; `None` above the horizon.
    pub fn ground_from_photo_px(
        &self,
        view: &View,
        photo_px: [f64; 2],
        look: &Look,
    ) -> Option<SurfaceHit> {
        let o = Vector3::from(view.position_m());
        let d = Vector3::from(view.ray(photo_px));
        if d.z >= -1e-6 {
            return None;
        }
        let (of, df) = (o.map(|v| v as f32), d.normalize().map(|v| v as f32));
        let t = match self.cast(of, df, look) {
            Some(hit) => f64::from(hit.t()),
            None => {
                return view.plane_from_photo_px(photo_px, 0.0).map(|p| SurfaceHit {
                    x_m: p[0],
                    y_m: p[1],
                    height_m: 0.0,
                });
            }
        };
        let p = o + d.normalize() * t;
        Some(SurfaceHit {
            x_m: p.x,
            y_m: p.y,
            height_m: p.z,
        })
    }
}

impl Hit {
    pub(crate) fn t(&self) -> f32 {
        match self {
            Self::Solid { hit, .. } => hit.t,
            Self::Tree { hit, .. } => hit.t,
        }
    }
}
