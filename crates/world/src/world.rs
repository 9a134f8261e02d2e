//! The world: ground and objects, ready to be rendered.

use nalgebra::{Vector2, Vector3};

use crate::config::WorldConfig;
use crate::cover::Cover;
use crate::ground::Ground;
use crate::look::Look;
use crate::objects::Objects;
use crate::populate::populate;
use crate::random::Stream;

/// Margin of the world around the map, metres, so that photos near the edge are complete.
const MARGIN_M: f32 = 160.0;

/// A procedural town and countryside. Frames are described at the crate's root.
#[derive(Debug)]
pub struct World {
    config: WorldConfig,
    pub(crate) ground: Ground,
    pub(crate) objects: Objects,
}

/// What kind of land a place is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Land {
    /// Houses, gardens, streets, works.
    Town,
    /// Fields, meadows, orchards, forest.
    Countryside,
    /// A river or a pond.
    Water,
}

impl World {
    /// Generates the world, in about 0.2 s per square kilometre.
    pub fn new(config: WorldConfig) -> Self {
        let config = config.clamped();
        let (low, high) = (-MARGIN_M, config.size_m as f32 + MARGIN_M);
        let made = populate(&config, low, high, &mut Stream::new(config.seed));
        Self {
            config,
            ground: made.ground,
            objects: Objects::new(low, high, made.solids, made.trees),
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
        (self.objects.solids.len(), self.objects.trees.len())
    }

    /// Height of the highest surface above a ground point, metres, in the epoch of `look`.
    pub fn height_at(&self, x_m: f64, y_m: f64, look: &Look) -> f64 {
        let o = Vector3::new(x_m as f32, y_m as f32, self.objects.top_m + 10.0);
        match self.objects.cast(o, -Vector3::z(), look) {
            Some(hit) => f64::from(o.z - hit.t()),
            None => 0.0,
        }
    }

    /// What kind of land a place is.
    pub fn land_at(&self, x_m: f64, y_m: f64) -> Land {
        match self.ground.cover(Vector2::new(x_m as f32, y_m as f32)) {
            Some(Cover::Water) => Land::Water,
            None | Some(Cover::Meadow | Cover::Crop | Cover::Orchard | Cover::ForestFloor) => {
                Land::Countryside
            }
            Some(_) => Land::Town,
        }
    }
}
