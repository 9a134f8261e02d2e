//! Rectangles of ground that buildings and other objects stand on.

use nalgebra::Vector2;

use crate::convex::{Convex, left_of};

type V2 = Vector2<f32>;

/// A rectangle in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Site {
    pub(super) centre: V2,
    pub(super) axis: V2,
    pub(super) half: V2,
}

impl Site {
    pub(super) fn at(&self, u: f32, v: f32) -> V2 {
        self.centre + self.axis * u + left_of(self.axis) * v
    }

    pub(super) fn part(&self, u: f32, v: f32, half_u: f32, half_v: f32) -> Self {
        Self {
            centre: self.at(u, v),
            axis: self.axis,
            half: V2::new(half_u, half_v),
        }
    }
}

/// The largest rectangle of at most `half` around `centre`, sides along `along`, inside the polygon.
pub(super) fn fit(outline: &Convex, centre: V2, along: V2, half: V2) -> Option<(V2, V2)> {
    let across = left_of(along);
    let mut centre = centre;
    let mut half = half;
    for _ in 0..28 {
        let mut push = V2::zeros();
        let mut worst = 0.0_f32;
        for (su, sv) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let corner = centre + along * (half.x * su) + across * (half.y * sv);
            let depth = outline.depth(corner);
            if depth < 0.0 {
                worst = worst.min(depth);
                push -= (corner - centre).normalize() * (-depth) * 0.4;
            }
        }
        if worst > -0.05 {
            return Some((centre, half));
        }
        centre += push;
        half *= 0.955;
    }
    None
}
