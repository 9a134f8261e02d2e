//! Parks, sports grounds and forests.

use nalgebra::Vector2;

use super::builder::Builder;
use super::site::Site;
use crate::convex::{Convex, left_of};
use crate::cover::Cover;
use crate::layout::Block;
use crate::noise::fbm;
use crate::tree::Species;

type V2 = Vector2<f32>;

impl Builder {
    pub(super) fn park(&mut self, block: &Block) {
        let outline = &block.outline;
        let frame = outline.frame();
        self.parcel(Cover::Lawn, outline.clone(), frame.along, 5);
        // Winding paths between points of the edge.
        let n = outline.points.len();
        let gates: Vec<V2> = (0..n)
            .map(|i| {
                let (a, b) = (outline.points[i], outline.points[(i + 1) % n]);
                a + (b - a) * self.random.range(0.3, 0.7)
            })
            .collect();
        let hub = frame.centre
            + V2::new(
                self.random.range(-0.15, 0.15),
                self.random.range(-0.15, 0.15),
            ) * frame.width_m;
        let cover = self
            .random
            .pick(&[Cover::Slabs, Cover::Gravel, Cover::Concrete]);
        let width = self.random.range(1.1, 2.0);
        for (i, gate) in gates.iter().enumerate() {
            let to = if self.random.chance(0.7) {
                hub
            } else {
                gates[(i + 1) % n]
            };
            let d = to - gate;
            let bow = left_of(d) * self.random.range(-0.22, 0.22);
            let points: Vec<V2> = (0..=16)
                .map(|k| {
                    let t = k as f32 / 16.0;
                    let wave = bow * (4.0 * t * (1.0 - t))
                        + left_of(d) * (0.03 * (t * 9.0 + i as f32).sin() * t * (1.0 - t) * 4.0);
                    self.ground.warp.world_from_layout(gate + d * t + wave)
                })
                .collect();
            self.ribbon(cover, &points, &[width; 17], 14);
            self.mark_ribbon(&points, &[width + 0.4; 17]);
        }
        let plaza = self.ground.warp.world_from_layout(hub);
        let radius = self.random.range(5.0, 11.0);
        self.patches.push(crate::cover::Patch {
            cover: Cover::Slabs,
            shape: crate::cover::Shape::Ellipse,
            centre: plaza,
            axis: V2::x(),
            half: V2::repeat(radius),
            rank: 15,
            seed: 0x51,
        });
        if self.random.chance(0.5) {
            let q = frame.centre + frame.along * (frame.length_m * self.random.range(-0.3, 0.3));
            let p = self.ground.warp.world_from_layout(q);
            let half = V2::new(self.random.range(12.0, 26.0), self.random.range(9.0, 18.0));
            if (p - plaza).norm() > half.max() * 1.5 + radius {
                self.pond(p, half);
            }
        }
        if self.random.chance(0.5) {
            let q = frame.centre - frame.along * (frame.length_m * 0.22);
            let spot = self.site(q, frame.along, V2::new(8.0, 6.0));
            if self.free(&spot, 1.0) {
                self.pave(Cover::Sand, &spot, 16);
            }
        }
        self.groves(outline, 30.0, 0.05);
    }

    /// Trees where a noise field is high, at about one per `area_m2` there.
    pub(super) fn groves(&mut self, outline: &Convex, area_m2: f32, threshold: f32) {
        let (low, high) = outline.bounds();
        let span = high - low;
        let shift = self.random.range(0.0, 400.0);
        let count = (span.x * span.y / area_m2) as usize;
        for _ in 0..count {
            let q = low + V2::new(self.random.unit() * span.x, self.random.unit() * span.y);
            let density = fbm(q.x * 0.55 + shift, q.y * 0.55);
            let lone = self.random.chance(0.04);
            if outline.depth(q) < 1.5 || density < threshold && !lone {
                continue;
            }
            let p = self.ground.warp.world_from_layout(q);
            let species = if density > 0.25 {
                Species::Broadleaf
            } else {
                self.any_species()
            };
            let radius = self.random.range(1.8, 5.2);
            self.tree(p, radius, species);
        }
    }

    pub(super) fn sports(&mut self, block: &Block) {
        let outline = &block.outline;
        let frame = outline.frame();
        self.parcel(Cover::Lawn, outline.clone(), frame.along, 5);
        let across = left_of(frame.along);
        let place = |b: &mut Builder, u: f32, v: f32, half: V2, cover: Cover| -> bool {
            let q = frame.centre + frame.along * u + across * v;
            let site = b.site(q, frame.along, half);
            let inside = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .iter()
                .all(|(a, c)| {
                    let corner = site.at(a * half.x, c * half.y);
                    outline.depth(b.ground.warp.layout_from_world(corner)) > 0.5
                });
            if !inside || !b.free(&site, 0.5) {
                return false;
            }
            b.take(&site);
            b.pave(cover, &site, 20);
            true
        };
        if place(self, 0.0, 0.0, V2::new(86.0, 46.0), Cover::Track) {
            let field = self.site(frame.centre, frame.along, V2::new(49.0, 32.0));
            self.pave(Cover::Pitch, &field, 21);
        } else {
            place(self, 0.0, 0.0, V2::new(54.0, 35.0), Cover::Pitch);
        }
        for _ in 0..40 {
            let u = self.random.range(-0.48, 0.48) * frame.length_m;
            let v = self.random.range(-0.48, 0.48) * frame.width_m;
            let q = frame.centre + frame.along * u + across * v;
            match self.random.below(6) {
                0 => {
                    place(self, u, v, V2::new(47.0, 31.0), Cover::Pitch);
                }
                1 | 2 => {
                    let (cover, half) = (Cover::Court, V2::new(17.5, 9.2));
                    for k in 0..1 + self.random.below(4) {
                        place(self, u, v + k as f32 * 18.6, half, cover);
                    }
                }
                3 => {
                    let half = V2::new(self.random.range(9.0, 18.0), self.random.range(7.0, 12.0));
                    let site = self.site(q, frame.along, half);
                    if outline.depth(q) > half.norm() && self.free(&site, 2.0) {
                        self.take(&site);
                        self.hall(&site, 7.5, crate::solid::Life::Fixed);
                    }
                }
                4 => {
                    let length = self.random.range(13.0, 28.0);
                    let lot = self.site(q, frame.along, V2::new(length, 8.25));
                    if outline.depth(q) > 20.0 && self.free(&lot, 0.5) {
                        self.parking(&lot, 0.4);
                    }
                }
                _ => {
                    let pool: Site = self.site(q, frame.along, V2::new(12.5, 8.0));
                    if self.random.chance(0.3) && outline.depth(q) > 20.0 && self.free(&pool, 5.0) {
                        let rim = Site {
                            half: pool.half + V2::repeat(5.0),
                            ..pool
                        };
                        self.pave(Cover::Slabs, &rim, 20);
                        self.pave(Cover::Pool, &pool, 22);
                        self.take(&rim);
                    }
                }
            }
        }
        self.groves(outline, 34.0, 0.2);
    }

    pub(super) fn forest(&mut self, block: &Block) {
        let outline = &block.outline;
        self.parcel(Cover::ForestFloor, outline.clone(), V2::x(), 5);
        let (low, high) = outline.bounds();
        let shift = self.random.range(0.0, 400.0);
        let kind = self.random.below(3);
        let planted = self.random.chance(0.25);
        let step = if planted { 4.6 } else { 5.4 };
        let axis = outline.frame().along;
        let mut y = low.y;
        while y < high.y {
            let mut x = low.x;
            while x < high.x {
                let jitter = if planted { 0.5 } else { 3.2 };
                let mut q = V2::new(x, y)
                    + V2::new(self.random.range(-1.0, 1.0), self.random.range(-1.0, 1.0)) * jitter;
                if planted {
                    let d = q - low;
                    q = low + axis * d.x + left_of(axis) * (d.y - (high.y - low.y) * 0.3);
                }
                x += step;
                let density = fbm(q.x * 0.45 + shift, q.y * 0.45);
                // Clearings.
                if outline.depth(q) < 1.0 || density < -0.42 {
                    continue;
                }
                let stand = fbm(q.x * 0.25, q.y * 0.25 + shift);
                let species = match kind {
                    0 => Species::Broadleaf,
                    1 if stand > 0.05 => Species::Conifer,
                    1 => Species::Broadleaf,
                    _ => self.random.pick(&[
                        Species::Broadleaf,
                        Species::Evergreen,
                        Species::Conifer,
                    ]),
                };
                let radius = match species {
                    Species::Conifer => self.random.range(2.0, 3.3),
                    _ => self.random.range(2.6, 5.2) * (1.0 + 0.3 * stand),
                };
                let p = self.ground.warp.world_from_layout(q);
                self.tree(p, radius, species);
            }
            y += step;
        }
    }
}
