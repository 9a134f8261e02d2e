//! A railway line across the world.

use nalgebra::Vector2;

use super::builder::Builder;
use crate::convex::left_of;
use crate::cover::Cover;
use crate::tree::Species;

type V2 = Vector2<f32>;

impl Builder {
    /// Two tracks in a wide curve; roads cross it on the level.
    pub(super) fn add_railway(&mut self, low: f32, high: f32) {
        if !self.random.chance(0.6) {
            return;
        }
        let span = high - low;
        let angle = self.random.range(0.0, std::f32::consts::TAU);
        let dir = V2::new(angle.cos(), angle.sin());
        let across = left_of(dir);
        let offset = self.random.range(-0.4, 0.4) * span;
        let wavelength = self.random.range(1500.0, 3000.0);
        let swing = self.random.range(60.0, 160.0);
        let phase = self.random.range(0.0, std::f32::consts::TAU);
        let mut points = Vec::new();
        let mut t = -span * 0.75;
        while t < span * 0.75 {
            let s = offset + swing * (std::f32::consts::TAU * t / wavelength + phase).sin();
            points.push(V2::repeat(low + span * 0.5) + dir * t + across * s);
            t += 12.0;
        }
        let verge = vec![9.5; points.len()];
        self.ribbon(Cover::Meadow, &points, &verge, 43);
        self.ribbon(Cover::Ballast, &points, &vec![5.0; points.len()], 44);
        self.mark_ribbon(&points, &verge);
        for p in &points {
            for side in [-1.0, 1.0] {
                if self.random.chance(0.25) {
                    let reach = self.random.range(7.0, 9.5);
                    let radius = self.random.range(0.8, 2.4);
                    self.tree_anywhere(p + across * (side * reach), radius, Species::Shrub);
                }
            }
        }
    }
}
