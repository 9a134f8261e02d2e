//! Buildings, cars and other solids: oriented boxes with a roof.

use nalgebra::Vector2;

use crate::bucket_grid::Extent;
use crate::convex::left_of;
use crate::random::{hash2, unit};

type V2 = Vector2<f32>;

/// Shape of a roof; the value is the rise from eaves to ridge in metres. The ridge runs along the local u axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Roof {
    Flat,
    Gable(f32),
    Hip(f32),
    /// Falls from +v to -v.
    Shed(f32),
    /// An arch across v.
    Barrel(f32),
    /// A cylinder with a shallow cone, the ellipse of the half sizes.
    Round(f32),
}

/// Material of a solid's surface, which decides its texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Finish {
    Tiles,
    Metal,
    Bitumen,
    Gravel,
    Membrane,
    Slab,
    Glass,
    Solar,
    Car,
    Van,
    Truck,
    Hedge,
    Plain,
    Wood,
}

/// Whether an object is present at a given epoch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Life {
    Fixed,
    /// May have been built, felled or torn down between epochs.
    Lasting,
    /// Present in this share of the epochs.
    Moving(f32),
}

impl Life {
    #[inline]
    pub(crate) fn present(self, seed: u32, epoch: u32, change: f32) -> bool {
        match self {
            Self::Fixed => true,
            Self::Lasting => {
                unit(hash2(seed, 0x51ab)) >= change || hash2(seed, epoch).is_multiple_of(2)
            }
            Self::Moving(share) => unit(hash2(seed, epoch ^ 0x77aa)) < share,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Solid {
    pub(crate) centre: V2,
    /// Unit vector of local u.
    pub(crate) axis: V2,
    pub(crate) half: V2,
    pub(crate) base_m: f32,
    pub(crate) eaves_m: f32,
    pub(crate) roof: Roof,
    pub(crate) finish: Finish,
    pub(crate) roof_rgb: [u8; 3],
    pub(crate) wall_rgb: [u8; 3],
    pub(crate) seed: u32,
    pub(crate) life: Life,
}

impl Solid {
    pub(crate) fn top_m(&self) -> f32 {
        self.eaves_m
            + match self.roof {
                Roof::Flat => 0.0,
                Roof::Gable(r)
                | Roof::Hip(r)
                | Roof::Shed(r)
                | Roof::Barrel(r)
                | Roof::Round(r) => r,
            }
    }

    #[inline]
    pub(crate) fn local(&self, p: V2) -> V2 {
        let d = p - self.centre;
        V2::new(d.dot(&self.axis), d.dot(&left_of(self.axis)))
    }

    /// Height of the roof over a local point, assuming it lies within the walls.
    #[cfg(test)]
    pub(crate) fn roof_height(&self, local: V2) -> f32 {
        let (u, v) = (local.x.abs(), local.y);
        let h = self.half;
        self.eaves_m
            + match self.roof {
                Roof::Flat => 0.0,
                Roof::Gable(r) => r * (1.0 - v.abs() / h.y),
                Roof::Hip(r) => r * (1.0 - v.abs() / h.y).min((h.x - u) / h.x.min(h.y)).max(0.0),
                Roof::Shed(r) => r * (v / h.y * 0.5 + 0.5),
                Roof::Barrel(r) => r * (1.0 - (v / h.y).powi(2)),
                Roof::Round(r) => r * (1.0 - (u / h.x).hypot(v / h.y)).max(0.0),
            }
    }
}

impl Extent for Solid {
    fn bounds(&self) -> (V2, V2) {
        let a = self.axis;
        let r = V2::new(
            a.x.abs() * self.half.x + a.y.abs() * self.half.y,
            a.y.abs() * self.half.x + a.x.abs() * self.half.y,
        );
        (self.centre - r, self.centre + r)
    }

    fn near(&self, centre: V2, radius_m: f32) -> bool {
        let l = self.local(centre).abs() - self.half;
        l.x < radius_m && l.y < radius_m && l.sup(&V2::zeros()).norm() < radius_m
    }
}
