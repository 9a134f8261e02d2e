//! Intersection of rays with solids. All solids but the round ones are convex polyhedra, so that a ray is clipped against
//! their planes (Kay and Kajiya 1986).

use nalgebra::{Vector2, Vector3};

use crate::convex::left_of;
use crate::solid::{Roof, Solid};

type V2 = Vector2<f32>;
type V3 = Vector3<f32>;

/// Kind of face that a ray hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Face {
    Wall,
    Roof,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct SolidHit {
    /// Distance along the ray, in lengths of its direction vector.
    pub(crate) t: f32,
    /// Unit, world axes.
    pub(crate) normal: V3,
    /// Local u, v (metres from the centre).
    pub(crate) local: V2,
    pub(crate) face: Face,
    pub(crate) face_index: u8,
}

/// The part of a ray `o + t d` inside the half spaces it was clipped against.
struct Span {
    o: V3,
    d: V3,
    /// Start of the interval, and the number of the plane there.
    enter: (f32, u8),
    /// End of the interval.
    leave: f32,
}

impl Span {
    #[inline]
    fn new(o: V3, d: V3, t_min: f32, t_max: f32) -> Self {
        Self {
            o,
            d,
            enter: (t_min, u8::MAX),
            leave: t_max,
        }
    }

    /// Clips by the half space `n . x <= c`.
    #[inline]
    fn clip(&mut self, n: V3, c: f32, index: u8) {
        self.clip_where(n.dot(&self.d), c - n.dot(&self.o), index);
    }

    /// Clips by a half space whose border the ray approaches at `speed` and that is `gap` away from its origin.
    #[inline]
    fn clip_where(&mut self, speed: f32, gap: f32, index: u8) {
        if speed < 0.0 {
            let t = gap / speed;
            if t > self.enter.0 {
                self.enter = (t, index);
            }
        } else if speed > 0.0 {
            self.leave = self.leave.min(gap / speed);
        } else if gap < 0.0 {
            self.leave = f32::NEG_INFINITY;
        }
    }
}

impl Solid {
    /// Where the ray `o + t d` first enters the solid between `t_min` and `t_max`.
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
        if let Roof::Round(rise) = self.roof {
            return self.intersect_round(lo, ld, rise, t_min, t_max);
        }
        let h = self.half;
        let mut span = Span::new(lo, ld, t_min, t_max);
        span.clip_where(ld.x, h.x - lo.x, 0);
        span.clip_where(-ld.x, h.x + lo.x, 1);
        span.clip_where(ld.y, h.y - lo.y, 2);
        span.clip_where(-ld.y, h.y + lo.y, 3);
        if span.enter.0 > span.leave {
            return None;
        }
        span.clip_where(-ld.z, lo.z - self.base_m, 4);
        self.clip_by_roof(&mut span);
        let (t, index) = span.enter;
        if t > span.leave || index == u8::MAX || index == 4 {
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

    /// Clips a ray in local coordinates by the planes of the roof, which are numbered from 5.
    #[inline]
    fn clip_by_roof(&self, span: &mut Span) {
        let (h, e) = (self.half, self.eaves_m);
        match self.roof {
            Roof::Flat => span.clip(V3::z(), e, 5),
            Roof::Gable(r) => {
                let k = r / h.y;
                span.clip(V3::new(0.0, k, 1.0), e + r, 6);
                span.clip(V3::new(0.0, -k, 1.0), e + r, 7);
            }
            Roof::Hip(r) => {
                let k = r / h.y;
                let ku = r / h.x.min(h.y);
                span.clip(V3::new(0.0, k, 1.0), e + r, 6);
                span.clip(V3::new(0.0, -k, 1.0), e + r, 7);
                span.clip(V3::new(ku, 0.0, 1.0), e + ku * h.x, 8);
                span.clip(V3::new(-ku, 0.0, 1.0), e + ku * h.x, 9);
            }
            Roof::Shed(r) => {
                let k = r * 0.5 / h.y;
                span.clip(V3::new(0.0, -k, 1.0), e + r * 0.5, 6);
            }
            Roof::Barrel(r) => {
                // Tangent planes of the parabola e + r (1 - (v / hv)^2).
                for (i, at) in [-0.85_f32, -0.5, 0.0, 0.5, 0.85].into_iter().enumerate() {
                    let k = 2.0 * r * at / h.y;
                    let c = e + r * (1.0 + at * at);
                    span.clip(V3::new(0.0, k, 1.0), c, 6 + i as u8);
                }
            }
            Roof::Round(_) => {}
        }
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
        let mut span = Span::new(o, d, t_min, t_max);
        if a > 1e-12 {
            let disc = b * b - a * c;
            if disc <= 0.0 {
                return None;
            }
            let root = disc.sqrt();
            let near = (-b - root) / a;
            if near > span.enter.0 {
                span.enter = (near, 0);
            }
            span.leave = span.leave.min((-b + root) / a);
        } else if c > 0.0 {
            return None;
        }
        span.clip(-V3::z(), -self.base_m, 4);
        span.clip(V3::z(), self.eaves_m, 5);
        let (t, index) = span.enter;
        if t > span.leave || index == u8::MAX || index == 4 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::{Finish, Life};

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
