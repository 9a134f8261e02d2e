//! A river and ponds.

use nalgebra::Vector2;

use super::builder::Builder;
use crate::convex::left_of;
use crate::cover::{Cover, Patch, Shape};
use crate::tree::Species;

type V2 = Vector2<f32>;

impl Builder {
    pub(super) fn add_waters(&mut self, low: f32, high: f32) {
        let span = high - low;
        if self.random.chance(0.75) {
            self.river(low, span);
        }
        let ponds = (span * span / 900_000.0 * self.random.range(0.3, 1.6)).round() as usize;
        for _ in 0..ponds {
            let centre = V2::new(self.random.range(0.1, 0.9), self.random.range(0.1, 0.9)) * span
                + V2::repeat(low);
            let half = V2::new(self.random.range(18.0, 60.0), self.random.range(14.0, 40.0));
            self.pond(centre, half);
        }
    }

    fn river(&mut self, low: f32, span: f32) {
        let angle = self.random.range(0.0, std::f32::consts::TAU);
        let dir = V2::new(angle.cos(), angle.sin());
        let across = left_of(dir);
        let offset = self.random.range(-0.35, 0.35) * span;
        let width = self.random.range(5.0, 17.0);
        let (l1, l2) = (
            self.random.range(320.0, 520.0),
            self.random.range(120.0, 210.0),
        );
        let (a1, a2) = (self.random.range(30.0, 70.0), self.random.range(6.0, 20.0));
        let phase = self.random.range(0.0, 6.0);
        let (mut points, mut widths) = (Vec::new(), Vec::new());
        let mut t = -span * 0.75;
        while t < span * 0.75 {
            let tau = std::f32::consts::TAU;
            let s = offset + a1 * (tau * t / l1 + phase).sin() + a2 * (tau * t / l2).sin();
            points.push(V2::repeat(low + span * 0.5) + dir * t + across * s);
            widths.push(width * (1.0 + 0.3 * (t / 47.0 + phase).sin() * (t / 29.0).cos()));
            t += 14.0;
        }
        let banks: Vec<f32> = widths.iter().map(|w| w + 5.0).collect();
        self.ribbon(Cover::Meadow, &points, &banks, 39);
        self.ribbon(Cover::Water, &points, &widths, 40);
        self.mark_ribbon(&points, &banks);
        for (p, w) in points.iter().zip(&widths) {
            for side in [-1.0, 1.0] {
                for _ in 0..2 {
                    if self.random.chance(0.45) {
                        let reach = w + self.random.range(0.5, 5.5);
                        let shift = dir * self.random.range(-7.0, 7.0);
                        let radius = self.random.range(1.5, 4.5);
                        let place = p + across * (side * reach) + shift;
                        if !self.ground.on_road(place, 1.0) {
                            self.tree_anywhere(place, radius, Species::Broadleaf);
                        }
                    }
                }
            }
        }
    }

    pub(super) fn mark_ribbon(&mut self, points: &[V2], half_m: &[f32]) {
        for (pair, half) in points.windows(2).zip(half_m) {
            let d = pair[1] - pair[0];
            let steps = (d.norm() / 0.7).ceil() as i32;
            let across = left_of(d.normalize());
            for i in 0..steps {
                let centre = pair[0] + d * (i as f32 / steps as f32);
                let mut s = -*half;
                while s < *half {
                    self.occupancy.take(centre + across * s);
                    s += 0.7;
                }
            }
        }
    }

    pub(super) fn pond(&mut self, centre: V2, half: V2) {
        let seed = self.seed();
        let angle = self.random.range(0.0, 3.0);
        let axis = V2::new(angle.cos(), angle.sin());
        let patch = |cover, half, rank| Patch {
            cover,
            shape: Shape::Blob(0.45),
            centre,
            axis,
            half,
            rank,
            seed,
        };
        let bank = patch(Cover::Meadow, half + V2::repeat(4.0), 36);
        let reach = half.max() * 1.5 + 5.0;
        let steps = reach as i32;
        for y in -steps..=steps {
            for x in -steps..=steps {
                let p = centre + V2::new(x as f32, y as f32);
                if bank.inside(p).is_some() {
                    self.occupancy.take(p);
                }
            }
        }
        for _ in 0..(half.norm() * 0.6) as usize {
            let a = self.random.range(0.0, std::f32::consts::TAU);
            let p = centre
                + axis * (half.x * a.cos() * 1.15)
                + left_of(axis) * (half.y * a.sin() * 1.15);
            if !self.ground.on_road(p, 1.0) {
                let radius = self.random.range(1.2, 4.0);
                self.tree_anywhere(p, radius, Species::Broadleaf);
            }
        }
        self.patches.push(bank);
        self.patches.push(patch(Cover::Water, half, 37));
    }
}
