//! Trees: ellipsoids with outline and surface modified by foliage clumps.

use nalgebra::{Vector2, Vector3};

use crate::bucket_grid::Extent;
use crate::look::Season;
use crate::noise::{Clump, clump};
use crate::random::unit;
use crate::solid::Life;

type V2 = Vector2<f32>;
type V3 = Vector3<f32>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Species {
    Broadleaf,
    Evergreen,
    Conifer,
    Fruit,
    Shrub,
}

#[derive(Clone, Debug)]
pub(crate) struct Tree {
    pub(crate) centre: V2,
    pub(crate) radius_m: f32,
    /// Bottom and top of the crown.
    pub(crate) base_m: f32,
    pub(crate) top_m: f32,
    pub(crate) species: Species,
    pub(crate) seed: u32,
    pub(crate) life: Life,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct TreeHit {
    pub(crate) t: f32,
    pub(crate) normal: V3,
    /// 0 in the middle of the crown, 1 at its rim.
    pub(crate) rho: f32,
    pub(crate) clump: Clump,
}

impl Tree {
    /// Whether only branches are left.
    #[inline]
    pub(crate) fn bare(&self, season: Season) -> bool {
        season == Season::Winter && matches!(self.species, Species::Broadleaf | Species::Fruit)
            || season == Season::Winter && self.species == Species::Shrub && self.seed & 1 == 0
    }

    #[inline]
    pub(crate) fn intersect(
        &self,
        o: V3,
        d: V3,
        t_min: f32,
        t_max: f32,
        season: Season,
    ) -> Option<TreeHit> {
        let rz = (self.top_m - self.base_m) * 0.5;
        let (ir, iz) = (1.0 / self.radius_m, 1.0 / rz);
        let oc = V3::new(
            (o.x - self.centre.x) * ir,
            (o.y - self.centre.y) * ir,
            (o.z - self.base_m - rz) * iz,
        );
        let dc = V3::new(d.x * ir, d.y * ir, d.z * iz);
        let a = dc.norm_squared();
        let b = oc.dot(&dc);
        let c = oc.norm_squared() - 1.0;
        let disc = b * b - a * c;
        if disc <= 0.0 {
            return None;
        }
        let t = (-b - disc.sqrt()) / a;
        if t <= t_min || t >= t_max {
            return None;
        }
        let p = oc + dc * t;
        let rho = (p.x * p.x + p.y * p.y).sqrt();
        // Clumps of a third of a metre to a metre and a half; the outline follows larger ones.
        let scale = 30.0 / (0.8 + self.radius_m * 0.16);
        let offset = unit(self.seed) * 512.0;
        let at = V2::new(o.x + d.x * t, o.y + d.y * t);
        let lift = p.z * 9.0;
        let c = clump(at.x * scale + offset, at.y * scale - offset + lift);
        let solid = if self.bare(season) {
            // Crowns of twigs: dense in the middle, open outside.
            c.height > 0.45 + 0.4 * rho
        } else if rho > 0.5 {
            let big = clump(at.x * scale * 0.37 - offset, at.y * scale * 0.37 + offset).height;
            rho < 0.44 + 0.52 * big + 0.2 * c.height
        } else {
            true
        };
        if !solid {
            return None;
        }
        let mut n = V3::new(p.x * ir, p.y * ir, p.z * iz).normalize();
        if self.species == Species::Conifer {
            n = V3::new(n.x * 1.6, n.y * 1.6, n.z * 0.7 + 0.15).normalize();
        }
        let bump = 0.95;
        let normal = V3::new(
            n.x - c.slope[0] * bump,
            n.y - c.slope[1] * bump,
            n.z.max(0.05) + 0.15,
        )
        .normalize();
        Some(TreeHit {
            t,
            normal,
            rho,
            clump: c,
        })
    }
}

impl Extent for Tree {
    fn bounds(&self) -> (V2, V2) {
        let r = V2::repeat(self.radius_m);
        (self.centre - r, self.centre + r)
    }

    fn near(&self, centre: V2, radius_m: f32) -> bool {
        (centre - self.centre).norm() < radius_m + self.radius_m
    }
}
