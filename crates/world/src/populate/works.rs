//! Industry: halls, yards, parking, tanks, containers.

use nalgebra::Vector2;

use super::builder::Builder;
use super::site::fit;
use crate::convex::{Convex, left_of};
use crate::cover::Cover;
use crate::layout::Block;
use crate::solid::{Finish, Life, Roof};
use crate::tree::Species;

type V2 = Vector2<f32>;

impl Builder {
    pub(super) fn works(&mut self, block: &Block) {
        let frame = block.outline.frame();
        let yard = self
            .random
            .pick(&[Cover::Asphalt, Cover::Concrete, Cover::Gravel]);
        let Some(inner) = block.outline.inset(4.0) else {
            return;
        };
        self.parcel(Cover::Lawn, block.outline.clone(), frame.along, 5);
        self.parcel(yard, inner.clone(), frame.along, 6);
        self.halls(&inner);
        self.yard_goods(&inner);
        self.stock(&inner, inner.frame().along);
        self.boundary_trees(&block.outline);
    }

    /// Halls, the first one large, with lorries at the loading bays of some.
    fn halls(&mut self, inner: &Convex) {
        let f = inner.frame();
        let across = left_of(f.along);
        let tries = 3 + (inner.area_m2() / 2500.0) as usize;
        for k in 0..tries {
            let u = self.random.range(-0.42, 0.42) * f.length_m;
            let v = self.random.range(-0.36, 0.36) * f.width_m;
            let big = if k == 0 {
                1.0
            } else {
                self.random.range(0.3, 0.8)
            };
            let half = V2::new(
                self.random.range(22.0, 46.0) * big,
                self.random.range(13.0, 26.0) * big,
            );
            let (u, v) = if k == 0 { (u * 0.3, v * 0.3) } else { (u, v) };
            let q = f.centre + f.along * u + across * v;
            let Some((centre, half)) = inner.inset(3.0).and_then(|i| fit(&i, q, f.along, half))
            else {
                continue;
            };
            if half.min() < 5.0 {
                continue;
            }
            let turned = self.random.chance(0.3);
            let (along, half) = if turned {
                (across, V2::new(half.y, half.x.min(half.y * 1.5)))
            } else {
                (f.along, half)
            };
            let site = self.site(centre, along, half);
            if !self.free(&site, 2.5) {
                continue;
            }
            self.take(&site);
            let height = self.random.range(6.0, 13.0);
            let life = self.house_life();
            self.hall(&site, height, life);
            // Loading bays with lorries along one side.
            if self.random.chance(0.6) {
                let n = (half.x / 3.0) as i32;
                for i in 0..n {
                    let u = ((i as f32 + 0.5) / n as f32 * 2.0 - 1.0) * half.x;
                    let p = site.at(u, half.y + 6.5);
                    if !self.occupancy.taken(p) {
                        self.lorry(p, left_of(site.axis), 0.3);
                    }
                }
            }
        }
    }

    /// Parking, containers, tanks and heaps.
    fn yard_goods(&mut self, inner: &Convex) {
        let f = inner.frame();
        let across = left_of(f.along);
        for _ in 0..3 {
            let q = f.centre
                + f.along * (self.random.range(-0.45, 0.45) * f.length_m)
                + across * (self.random.range(-0.45, 0.45) * f.width_m);
            match self.random.below(4) {
                0 => {
                    let length = self.random.range(13.0, 30.0);
                    let lot = self.site(q, f.along, V2::new(length, 8.25));
                    if inner.depth(q) > 9.0 && self.free(&lot, 0.5) {
                        self.parking(&lot, 0.65);
                    }
                }
                1 => self.containers(q, f.along, inner),
                2 => {
                    let radius = self.random.range(3.0, 9.0);
                    for k in 0..1 + self.random.below(4) {
                        let c = q + f.along * (k as f32 * radius * 2.4);
                        let tank = self.site(c, f.along, V2::repeat(radius));
                        if inner.depth(c) > radius && self.free(&tank, 1.0) {
                            self.take(&tank);
                            let colour = self.sheet_colour();
                            let top = self.random.range(5.0, 14.0);
                            self.solid(
                                &tank,
                                0.0,
                                top,
                                Roof::Round(0.6),
                                Finish::Plain,
                                colour,
                                colour,
                                Life::Fixed,
                            );
                        }
                    }
                }
                _ => {
                    let half = V2::new(self.random.range(4.0, 12.0), self.random.range(4.0, 9.0));
                    let heap = self.site(q, f.along, half);
                    if inner.depth(q) > 10.0 && self.free(&heap, 0.5) {
                        self.pave(Cover::Site, &heap, 20);
                    }
                }
            }
        }
    }

    /// Trees along some of the edges.
    fn boundary_trees(&mut self, outline: &Convex) {
        let n = outline.points.len();
        for i in 0..n {
            if !self.random.chance(0.4) {
                continue;
            }
            let (a, b) = (outline.points[i], outline.points[(i + 1) % n]);
            let length = (b - a).norm();
            let dir = (b - a) / length.max(1e-3);
            let step = self.random.range(7.0, 12.0);
            for k in 0..(length / step) as i32 {
                let q = a + dir * ((k as f32 + 0.5) * step) + left_of(dir) * 2.2;
                let p = self.ground.warp.world_from_layout(q);
                let radius = self.random.range(1.8, 3.2);
                self.tree(p, radius, Species::Broadleaf);
            }
        }
    }

    fn containers(&mut self, q: V2, along: V2, inner: &Convex) {
        const PAINT: [[u8; 3]; 6] = [
            [150, 70, 54],
            [60, 90, 130],
            [70, 110, 80],
            [180, 130, 60],
            [170, 170, 168],
            [110, 60, 60],
        ];
        let rows = 2 + self.random.below(5);
        let columns = 1 + self.random.below(3);
        for row in 0..rows {
            for column in 0..columns {
                if self.random.chance(0.2) {
                    continue;
                }
                let c = q + left_of(along) * (row as f32 * 2.7) + along * (column as f32 * 12.9);
                let site = self.site(c, along, V2::new(6.05, 1.22));
                if inner.depth(c) < 7.0 || !self.free(&site, 0.1) {
                    continue;
                }
                let colour = self.random.pick(&PAINT);
                let top = 2.6 * (1 + self.random.below(2)) as f32;
                self.solid(
                    &site,
                    0.0,
                    top,
                    Roof::Flat,
                    Finish::Metal,
                    colour,
                    colour,
                    Life::Moving(0.8),
                );
            }
        }
    }
}
