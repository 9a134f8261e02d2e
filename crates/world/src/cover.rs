//! Ground cover: kinds and outlines of patches.

use nalgebra::Vector2;

use crate::bucket_grid::Extent;
use crate::convex::{Convex, HalfPlanes, left_of};
use crate::noise::fbm;
use crate::random::unit;

type V2 = Vector2<f32>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cover {
    Lawn,
    Meadow,
    Crop,
    Orchard,
    ForestFloor,
    Garden,
    Allotment,
    Asphalt,
    /// Rows of parking bays along local u.
    Stalls,
    Concrete,
    Slabs,
    Gravel,
    Dirt,
    Sand,
    Water,
    Pool,
    /// Football pitch.
    Pitch,
    /// Tennis or basketball court.
    Court,
    /// Running track round a pitch.
    Track,
    Ballast,
    Graves,
    Site,
}

/// Outline of a patch; a convex one comes with its bounds.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    Convex(HalfPlanes, V2, V2),
    Rectangle,
    Ellipse,
    /// An ellipse whose radius varies by this share with direction.
    Blob(f32),
    /// From `a` to `b` with a half width at each.
    Segment {
        a: V2,
        b: V2,
        half_m: [f32; 2],
        start_m: f32,
    },
}

/// A piece of ground with one cover. Higher `rank` lies on top.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    pub(crate) cover: Cover,
    pub(crate) shape: Shape,
    pub(crate) centre: V2,
    pub(crate) axis: V2,
    pub(crate) half: V2,
    pub(crate) rank: u8,
    pub(crate) seed: u32,
}

/// A point inside a patch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inside {
    pub(crate) depth: f32,
    pub(crate) local: V2,
}

impl Patch {
    pub(crate) fn convex(cover: Cover, shape: Convex, axis: V2, rank: u8, seed: u32) -> Self {
        let frame = shape.frame_along(axis);
        Self {
            cover,
            centre: frame.centre,
            axis,
            half: V2::new(frame.length_m, frame.width_m) * 0.5,
            shape: Shape::Convex(shape.half_planes(), shape.bounds().0, shape.bounds().1),
            rank,
            seed,
        }
    }

    pub(crate) fn rectangle(
        cover: Cover,
        centre: V2,
        axis: V2,
        half: V2,
        rank: u8,
        seed: u32,
    ) -> Self {
        Self {
            cover,
            shape: Shape::Rectangle,
            centre,
            axis,
            half,
            rank,
            seed,
        }
    }

    #[inline]
    pub(crate) fn inside(&self, p: V2) -> Option<Inside> {
        let d = p - self.centre;
        let local = V2::new(d.dot(&self.axis), d.dot(&left_of(self.axis)));
        let depth = match &self.shape {
            Shape::Convex(polygon, ..) => polygon.depth(p),
            Shape::Rectangle => (self.half - local.abs()).min(),
            Shape::Ellipse => {
                (1.0 - (local.x / self.half.x).hypot(local.y / self.half.y)) * self.half.min()
            }
            Shape::Blob(amount) => {
                let r = (local.x / self.half.x).hypot(local.y / self.half.y);
                let angle = local.y.atan2(local.x);
                let phase = unit(self.seed) * 400.0;
                let wobble = fbm(phase + 20.0 * angle.cos(), phase + 20.0 * angle.sin());
                (1.0 + amount * wobble - r) * self.half.min()
            }
            Shape::Segment {
                a,
                b,
                half_m,
                start_m,
            } => {
                let e = b - a;
                let length = e.norm().max(1e-3);
                let dir = e / length;
                let along = (p - a).dot(&dir);
                let t = (along / length).clamp(0.0, 1.0);
                let half = half_m[0] + (half_m[1] - half_m[0]) * t;
                let depth = half - (p - a - e * t).norm();
                let side = (p - a).dot(&left_of(dir));
                return (depth > 0.0).then(|| Inside {
                    depth,
                    local: V2::new(start_m + along, side),
                });
            }
        };
        (depth > 0.0).then_some(Inside { depth, local })
    }
}

impl Extent for Patch {
    fn bounds(&self) -> (V2, V2) {
        match &self.shape {
            Shape::Convex(_, low, high) => (*low, *high),
            Shape::Segment { a, b, half_m, .. } => {
                let r = V2::repeat(half_m[0].max(half_m[1]));
                (a.inf(b) - r, a.sup(b) + r)
            }
            Shape::Blob(amount) => {
                let r = V2::repeat(self.half.max() * (1.0 + amount));
                (self.centre - r, self.centre + r)
            }
            _ => {
                let r = V2::repeat(self.half.norm());
                (self.centre - r, self.centre + r)
            }
        }
    }

    fn near(&self, centre: V2, radius_m: f32) -> bool {
        match &self.shape {
            // Depth is measured to edge lines, so sharp corners err towards true.
            Shape::Convex(polygon, ..) => polygon.depth(centre) > -radius_m,
            Shape::Segment { a, b, half_m, .. } => {
                let e = b - a;
                let t = ((centre - a).dot(&e) / e.norm_squared().max(1e-6)).clamp(0.0, 1.0);
                (centre - a - e * t).norm() < half_m[0].max(half_m[1]) + radius_m
            }
            _ => {
                let d = centre - self.centre;
                let l = V2::new(d.dot(&self.axis), d.dot(&left_of(self.axis))).abs();
                let grow = if let Shape::Blob(a) = self.shape {
                    1.0 + a
                } else {
                    1.0
                };
                l.x < self.half.x * grow + radius_m && l.y < self.half.y * grow + radius_m
            }
        }
    }
}
