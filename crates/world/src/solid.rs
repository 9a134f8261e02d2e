//! Buildings, cars and other solids: oriented boxes with a roof, all convex, so that a ray meets
//! them by clipping against their planes (Kay and Kajiya 1986).

use nalgebra::{Vector2, Vector3};

use crate::bucket_grid::Extent;
use crate::convex::left_of;
use crate::random::{hash2, unit};

type V2 = Vector2<f32>;
type V3 = Vector3<f32>;

/// What stands on the walls; rise in metres from eaves to ridge, ridge along the local u axis.
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

/// Surface of a solid; decides its texture.
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

/// Whether a thing is there at a given moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Life {
    Fixed,
    /// May have been built, felled or torn down between epochs.
    Lasting,
    /// Stands here in this share of the epochs.
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

/// Which kind of face a ray met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Face {
    Wall,
    Roof,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct SolidHit {
    pub(crate) t: f32,
    /// Unit, world axes.
    pub(crate) normal: V3,
    /// Local u, v (metres from the centre).
    pub(crate) local: V2,
    pub(crate) face: Face,
    pub(crate) face_index: u8,
}

/// Clips the ray's interval by the half space `n . x <= c`.
#[inline]
fn clip(o: V3, d: V3, n: V3, c: f32, index: u8, enter: &mut (f32, u8), leave: &mut f32) {
    let speed = n.dot(&d);
    let gap = c - n.dot(&o);
    if speed < 0.0 {
        let t = gap / speed;
        if t > enter.0 {
            *enter = (t, index);
        }
    } else if speed > 0.0 {
        *leave = leave.min(gap / speed);
    } else if gap < 0.0 {
        *leave = f32::NEG_INFINITY;
    }
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

    /// First entry of the ray `o + t d` between `t_min` and `t_max`.
    #[inline]
    pub(crate) fn intersect(&self, o: V3, d: V3, t_min: f32, t_max: f32) -> Option<SolidHit> {
        let across = left_of(self.axis);
        let rel = V2::new(o.x - self.centre.x, o.y - self.centre.y);
        let (dx, dy) = (
            V2::new(d.x, d.y).dot(&self.axis),
            V2::new(d.x, d.y).dot(&across),
        );
        let lo = V3::new(rel.dot(&self.axis), rel.dot(&across), o.z);
        let ld = V3::new(dx, dy, d.z);
        let h = self.half;
        let mut enter = (t_min, u8::MAX);
        let mut leave = t_max;
        if let Roof::Round(rise) = self.roof {
            return self.intersect_round(lo, ld, rise, t_min, t_max);
        }
        clip(lo, ld, V3::x(), h.x, 0, &mut enter, &mut leave);
        clip(lo, ld, -V3::x(), h.x, 1, &mut enter, &mut leave);
        clip(lo, ld, V3::y(), h.y, 2, &mut enter, &mut leave);
        clip(lo, ld, -V3::y(), h.y, 3, &mut enter, &mut leave);
        if enter.0 > leave {
            return None;
        }
        clip(lo, ld, -V3::z(), -self.base_m, 4, &mut enter, &mut leave);
        let e = self.eaves_m;
        match self.roof {
            Roof::Flat => clip(lo, ld, V3::z(), e, 5, &mut enter, &mut leave),
            Roof::Gable(r) => {
                let k = r / h.y;
                clip(
                    lo,
                    ld,
                    V3::new(0.0, k, 1.0),
                    e + r,
                    6,
                    &mut enter,
                    &mut leave,
                );
                clip(
                    lo,
                    ld,
                    V3::new(0.0, -k, 1.0),
                    e + r,
                    7,
                    &mut enter,
                    &mut leave,
                );
            }
            Roof::Hip(r) => {
                let k = r / h.y;
                let ku = r / h.x.min(h.y);
                clip(
                    lo,
                    ld,
                    V3::new(0.0, k, 1.0),
                    e + r,
                    6,
                    &mut enter,
                    &mut leave,
                );
                clip(
                    lo,
                    ld,
                    V3::new(0.0, -k, 1.0),
                    e + r,
                    7,
                    &mut enter,
                    &mut leave,
                );
                clip(
                    lo,
                    ld,
                    V3::new(ku, 0.0, 1.0),
                    e + ku * h.x,
                    8,
                    &mut enter,
                    &mut leave,
                );
                clip(
                    lo,
                    ld,
                    V3::new(-ku, 0.0, 1.0),
                    e + ku * h.x,
                    9,
                    &mut enter,
                    &mut leave,
                );
            }
            Roof::Shed(r) => {
                let k = r * 0.5 / h.y;
                clip(
                    lo,
                    ld,
                    V3::new(0.0, -k, 1.0),
                    e + r * 0.5,
                    6,
                    &mut enter,
                    &mut leave,
                );
            }
            Roof::Barrel(r) => {
                // Tangent planes of the parabola e + r (1 - (v / hv)^2).
                for (i, at) in [-0.85_f32, -0.5, 0.0, 0.5, 0.85].into_iter().enumerate() {
                    let k = 2.0 * r * at / h.y;
                    let c = e + r * (1.0 + at * at);
                    clip(
                        lo,
                        ld,
                        V3::new(0.0, k, 1.0),
                        c,
                        6 + i as u8,
                        &mut enter,
                        &mut leave,
                    );
                }
            }
            Roof::Round(_) => {}
        }
        let (t, index) = enter;
        if t > leave || index == u8::MAX || index == 4 {
            return None;
        }
        let p = lo + ld * t;
        let n = match index {
            0 => V3::x(),
            1 => -V3::x(),
            2 => V3::y(),
            3 => -V3::y(),
            5 => V3::z(),
            _ => self.roof_normal(index, p),
        };
        let world = self.axis * n.x + across * n.y;
        Some(SolidHit {
            t,
            normal: V3::new(world.x, world.y, n.z),
            local: V2::new(p.x, p.y),
            face: if index < 4 { Face::Wall } else { Face::Roof },
            face_index: index,
        })
    }

    fn roof_normal(&self, index: u8, p: V3) -> V3 {
        let h = self.half;
        match self.roof {
            Roof::Gable(r) | Roof::Hip(r) if index < 8 => {
                V3::new(0.0, if index == 6 { r } else { -r } / h.y, 1.0).normalize()
            }
            Roof::Hip(r) => {
                V3::new(if index == 8 { r } else { -r } / h.x.min(h.y), 0.0, 1.0).normalize()
            }
            Roof::Shed(r) => V3::new(0.0, -r * 0.5 / h.y, 1.0).normalize(),
            Roof::Barrel(r) => V3::new(0.0, 2.0 * r * p.y / (h.y * h.y), 1.0).normalize(),
            _ => V3::z(),
        }
    }

    fn intersect_round(&self, o: V3, d: V3, rise: f32, t_min: f32, t_max: f32) -> Option<SolidHit> {
        let h = self.half;
        let (ox, oy, dx, dy) = (o.x / h.x, o.y / h.y, d.x / h.x, d.y / h.y);
        let a = dx * dx + dy * dy;
        let b = ox * dx + oy * dy;
        let c = ox * ox + oy * oy - 1.0;
        let (mut enter, mut leave) = ((t_min, u8::MAX), t_max);
        if a > 1e-12 {
            let disc = b * b - a * c;
            if disc <= 0.0 {
                return None;
            }
            let root = disc.sqrt();
            let near = (-b - root) / a;
            if near > enter.0 {
                enter = (near, 0);
            }
            leave = leave.min((-b + root) / a);
        } else if c > 0.0 {
            return None;
        }
        clip(o, d, -V3::z(), -self.base_m, 4, &mut enter, &mut leave);
        clip(o, d, V3::z(), self.eaves_m, 5, &mut enter, &mut leave);
        let (t, index) = enter;
        if t > leave || index == u8::MAX || index == 4 {
            return None;
        }
        let p = o + d * t;
        let slope = rise / h.x.min(h.y);
        let out = V2::new(p.x / h.x, p.y / h.y);
        let n = if index == 0 {
            V3::new(out.x, out.y, 0.0).normalize()
        } else {
            let r = out.norm().max(1e-3);
            V3::new(slope * out.x / r, slope * out.y / r, 1.0).normalize()
        };
        let world = self.axis * n.x + left_of(self.axis) * n.y;
        Some(SolidHit {
            t,
            normal: V3::new(world.x, world.y, n.z),
            local: V2::new(p.x, p.y),
            face: if index == 0 { Face::Wall } else { Face::Roof },
            face_index: index,
        })
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

#[cfg(test)]
mod tests {
    use super::*;

    fn house(roof: Roof) -> Solid {
        Solid {
            centre: V2::new(50.0, 40.0),
            axis: V2::new(0.8, 0.6),
            half: V2::new(8.0, 5.0),
            base_m: 0.0,
            eaves_m: 6.0,
            roof,
            finish: Finish::Tiles,
            roof_rgb: [150, 90, 70],
            wall_rgb: [200; 3],
            seed: 1,
            life: Life::Fixed,
        }
    }

    #[test]
    fn vertical_rays_meet_the_roof_at_its_height() {
        for roof in [
            Roof::Flat,
            Roof::Gable(3.0),
            Roof::Hip(3.0),
            Roof::Shed(2.0),
        ] {
            let solid = house(roof);
            for local in [V2::new(0.0, 0.0), V2::new(6.5, 2.0), V2::new(-3.0, -4.0)] {
                let p = solid.centre + solid.axis * local.x + left_of(solid.axis) * local.y;
                let hit = solid
                    .intersect(V3::new(p.x, p.y, 100.0), -V3::z(), 0.0, 200.0)
                    .unwrap();
                let expected = solid.roof_height(local);
                assert!((100.0 - hit.t - expected).abs() < 1e-3, "{roof:?} {local}");
                assert_eq!(hit.face, Face::Roof);
                assert!((hit.normal.norm() - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn level_rays_meet_walls_and_pass_above() {
        let solid = house(Roof::Gable(3.0));
        let d = V3::new(1.0, 0.0, 0.0);
        let hit = solid
            .intersect(V3::new(0.0, 40.0, 3.0), d, 0.0, 200.0)
            .unwrap();
        assert_eq!(hit.face, Face::Wall);
        assert!(hit.normal.dot(&d) < 0.0);
        assert!(
            solid
                .intersect(V3::new(0.0, 40.0, 9.5), d, 0.0, 200.0)
                .is_none()
        );
    }
}
