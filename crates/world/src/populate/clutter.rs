//! Small objects in yards and gardens: fences, crates, furniture.

use nalgebra::Vector2;

use super::builder::Builder;
use super::site::Site;
use crate::convex::{Convex, left_of};
use crate::cover::Cover;
use crate::solid::{Finish, Life, Roof};

type V2 = Vector2<f32>;

const GOODS: [[u8; 3]; 9] = [
    [186, 150, 104],
    [150, 116, 80],
    [214, 212, 206],
    [70, 74, 78],
    [58, 96, 140],
    [160, 60, 48],
    [84, 118, 82],
    [206, 172, 70],
    [130, 130, 128],
];

impl Builder {
    /// A wall or fence inside the edges of a parcel that do not face a street.
    pub(super) fn fences(&mut self, parcel: &Convex, chance: f32) {
        let n = parcel.points.len();
        for i in 0..n {
            if parcel.edge_half_width_m[i] > 0.0 || !self.random.chance(chance) {
                continue;
            }
            let (a, b) = (parcel.points[i], parcel.points[(i + 1) % n]);
            let d = b - a;
            if d.norm() < 4.0 {
                continue;
            }
            let dir = d.normalize();
            let site = self.site(
                (a + b) * 0.5 + left_of(dir) * 0.18,
                dir,
                V2::new(d.norm() * 0.5 - 0.4, 0.09),
            );
            let colour = self
                .random
                .pick(&[[166, 148, 120], [120, 104, 88], [196, 192, 184]]);
            let height = self.random.range(1.0, 1.9);
            self.solid(
                &site,
                0.0,
                height,
                Roof::Flat,
                Finish::Wood,
                colour,
                colour,
                Life::Fixed,
            );
        }
    }

    /// Crates, furniture, bins, skips: `count` of them strewn over a layout polygon.
    pub(super) fn strew(&mut self, outline: &Convex, count: usize, largest_m: f32) {
        let (low, high) = outline.bounds();
        for _ in 0..count {
            let q = V2::new(
                self.random.range(low.x, high.x),
                self.random.range(low.y, high.y),
            );
            if outline.depth(q) < 1.0 {
                continue;
            }
            let turn = self.random.range(0.0, 3.1);
            let (hu, hv) = (
                self.random.range(0.25, largest_m),
                self.random.range(0.25, 0.8),
            );
            let site = Site {
                centre: self.ground.warp.world_from_layout(q),
                axis: V2::new(turn.cos(), turn.sin()),
                half: V2::new(hu, hv.min(hu)),
            };
            if self.occupancy.taken(site.centre) {
                continue;
            }
            let colour = self.random.pick(&GOODS);
            let roof = if self.random.chance(0.25) {
                Roof::Round(0.1)
            } else {
                Roof::Flat
            };
            let height = self.random.range(0.4, 1.0 + hu * 0.6);
            let life = if self.random.chance(0.6) {
                Life::Moving(0.75)
            } else {
                Life::Fixed
            };
            self.solid(
                &site,
                0.0,
                height,
                roof,
                Finish::Plain,
                colour,
                colour,
                life,
            );
        }
    }

    /// Rows of goods and parked vehicles on a yard.
    pub(super) fn stock(&mut self, outline: &Convex, along: V2) {
        let frame = outline.frame_along(along);
        let across = left_of(along);
        for _ in 0..(outline.area_m2() / 900.0) as usize {
            let q = frame.centre
                + along * (self.random.range(-0.48, 0.48) * frame.length_m)
                + across * (self.random.range(-0.48, 0.48) * frame.width_m);
            let dir = if self.random.chance(0.5) {
                along
            } else {
                across
            };
            let n = 2 + self.random.below(7);
            let colour = self.random.pick(&GOODS);
            match self.random.below(4) {
                0 => {
                    for k in 0..n {
                        let c = q + left_of(dir) * (k as f32 * 2.8);
                        let site = self.site(c, dir, V2::new(2.4, 1.0));
                        if outline.depth(c) > 3.0 && self.free(&site, 0.0) {
                            self.car(site.centre, site.axis, 0.6);
                        }
                    }
                }
                1 => {
                    for k in 0..n.min(4) {
                        let c = q + left_of(dir) * (k as f32 * 3.6);
                        let site = self.site(c, dir, V2::new(6.0, 1.3));
                        if outline.depth(c) > 7.0 && self.free(&site, 0.0) {
                            self.lorry(site.centre, site.axis, 0.6);
                        }
                    }
                }
                2 => {
                    let half = V2::new(self.random.range(1.5, 5.0), self.random.range(0.6, 1.4));
                    for k in 0..n {
                        let c = q + left_of(dir) * (k as f32 * (half.y * 2.0 + 0.5));
                        let site = self.site(c, dir, half);
                        if outline.depth(c) > half.x && self.free(&site, 0.0) {
                            let height = self.random.range(0.5, 2.2);
                            let (finish, life) = (Finish::Wood, Life::Moving(0.8));
                            self.solid(
                                &site,
                                0.0,
                                height,
                                Roof::Flat,
                                finish,
                                colour,
                                colour,
                                life,
                            );
                        }
                    }
                }
                _ => {
                    let half = V2::new(self.random.range(3.0, 9.0), self.random.range(2.0, 6.0));
                    let site = self.site(q, dir, half);
                    let cover = self
                        .random
                        .pick(&[Cover::Concrete, Cover::Asphalt, Cover::Gravel]);
                    if outline.depth(q) > half.norm() && self.free(&site, 0.0) {
                        self.pave(cover, &site, 12);
                    }
                }
            }
        }
        let count = (outline.area_m2() / 130.0) as usize;
        self.strew(outline, count, 1.5);
    }
}
