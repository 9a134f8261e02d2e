//! Fields, orchards, pastures and farms.

use nalgebra::Vector2;

use super::builder::Builder;
use super::site::Site;
use crate::convex::left_of;
use crate::cover::Cover;
use crate::layout::Block;
use crate::solid::{Finish, Life, Roof};
use crate::tree::Species;

type V2 = Vector2<f32>;

impl Builder {
    pub(super) fn field(&mut self, block: &Block) {
        let frame = block.outline.frame();
        match self.random.below(12) {
            0 => {
                self.parcel(Cover::Allotment, block.outline.clone(), frame.along, 5);
                self.garden_trees(&block.outline, 12);
            }
            1 => self.farm(block),
            2 => self.greenhouses(block),
            _ => {
                // Long fields are strips of different crops.
                let strips = if self.random.chance(0.35) {
                    2 + self.random.below(5)
                } else {
                    1
                };
                let across = left_of(frame.along);
                let mut rest = block.outline.clone();
                for k in 1..=strips {
                    let origin =
                        frame.centre + across * (frame.width_m * (k as f32 / strips as f32 - 0.5));
                    let piece = if k == strips {
                        Some(rest.clone())
                    } else {
                        rest.clip_left(origin, -frame.along, 0.0)
                    };
                    if let Some(piece) = piece {
                        self.parcel(Cover::Crop, piece, frame.along, 5);
                    }
                    if k < strips {
                        match rest.clip_left(origin, frame.along, 0.0) {
                            Some(r) => rest = r,
                            None => break,
                        }
                    }
                }
                self.field_edges(block, 0.3);
                if self.random.chance(0.25) {
                    // A lone tree or a thicket in the field.
                    let q = frame.centre
                        + frame.along * (frame.length_m * self.random.range(-0.3, 0.3));
                    let p = self.ground.warp.world_from_layout(q);
                    for _ in 0..1 + self.random.below(6) {
                        let shift = V2::new(self.random.normal(), self.random.normal()) * 4.0;
                        let radius = self.random.range(1.5, 4.5);
                        self.tree(p + shift, radius, Species::Broadleaf);
                    }
                }
            }
        }
    }

    /// Hedgerows and tree lines along some edges.
    fn field_edges(&mut self, block: &Block, chance: f32) {
        let n = block.outline.points.len();
        for i in 0..n {
            if !self.random.chance(chance) {
                continue;
            }
            let (a, b) = (block.outline.points[i], block.outline.points[(i + 1) % n]);
            let length = (b - a).norm();
            let dir = (b - a) / length.max(1e-3);
            let dense = self.random.chance(0.6);
            let mut t = 2.0;
            while t < length - 2.0 {
                let q = a + dir * t + left_of(dir) * (1.4 + self.random.normal() * 0.5);
                let p = self.ground.warp.world_from_layout(q);
                let shrub = self.random.chance(if dense { 0.6 } else { 0.2 });
                let radius = if shrub {
                    self.random.range(0.9, 1.8)
                } else {
                    self.random.range(2.0, 4.4)
                };
                let species = if shrub {
                    Species::Shrub
                } else {
                    Species::Broadleaf
                };
                if self.random.chance(0.85) {
                    self.tree(p, radius, species);
                }
                t += if dense {
                    self.random.range(2.0, 4.5)
                } else {
                    self.random.range(7.0, 14.0)
                };
            }
        }
    }

    pub(super) fn orchard(&mut self, block: &Block) {
        let frame = block.outline.frame();
        self.parcel(Cover::Orchard, block.outline.clone(), frame.along, 5);
        let across = left_of(frame.along);
        let step = self.random.range(3.2, 5.0);
        let size = self.random.range(1.1, 1.9);
        let rows = (frame.width_m / 4.5) as i32;
        for row in 0..=rows {
            // Rows stand on the grass, half way between the bare strips of the cover.
            let v = (row as f32 - (rows / 2) as f32) * 4.5 - 2.25;
            let mut u = -frame.length_m * 0.5;
            while u < frame.length_m * 0.5 {
                let q = frame.centre + frame.along * u + across * v;
                u += step;
                if block.outline.depth(q) < 2.5 || self.random.chance(0.05) {
                    continue;
                }
                let p = self.ground.warp.world_from_layout(q);
                let radius = size * self.random.range(0.8, 1.2);
                self.tree(p, radius, Species::Fruit);
            }
        }
    }

    pub(super) fn pasture(&mut self, block: &Block) {
        let frame = block.outline.frame();
        let cover = if self.random.chance(0.15) {
            Cover::Dirt
        } else {
            Cover::Meadow
        };
        self.parcel(cover, block.outline.clone(), frame.along, 5);
        self.field_edges(block, 0.5);
        self.groves(&block.outline, 90.0, 0.35);
        // Paths worn by animals and people.
        for _ in 0..1 + self.random.below(3) {
            let a = frame.centre
                + frame.along * (frame.length_m * self.random.range(-0.5, 0.5))
                + left_of(frame.along) * (frame.width_m * -0.5);
            let b = frame.centre
                + frame.along * (frame.length_m * self.random.range(-0.5, 0.5))
                + left_of(frame.along) * (frame.width_m * 0.5);
            let points: Vec<V2> = (0..=12)
                .map(|k| {
                    let t = k as f32 / 12.0;
                    let sway = left_of(b - a) * (0.06 * (t * 7.0 + a.x).sin());
                    self.ground.warp.world_from_layout(a + (b - a) * t + sway)
                })
                .collect();
            let width = self.random.range(0.5, 1.0);
            self.ribbon(Cover::Dirt, &points, &[width; 13], 8);
        }
    }

    fn farm(&mut self, block: &Block) {
        let frame = block.outline.frame();
        self.parcel(Cover::Meadow, block.outline.clone(), frame.along, 5);
        let yard = self.site(frame.centre, frame.along, V2::new(26.0, 18.0));
        self.pave(Cover::Dirt, &yard, 9);
        for _ in 0..9 {
            let u = self.random.range(-26.0, 26.0);
            let v = self.random.range(-18.0, 18.0);
            let half = V2::new(self.random.range(5.0, 14.0), self.random.range(4.0, 7.5));
            let turned = self.random.chance(0.4);
            let base = yard.part(u, v, half.x, half.y);
            let site = if turned {
                Site {
                    axis: left_of(base.axis),
                    ..base
                }
            } else {
                base
            };
            if !self.free(&site, 1.5) {
                continue;
            }
            self.take(&site);
            if self.random.chance(0.4) {
                let tiles = self.tile_colour();
                self.pitched_house(&site, 4.5, tiles, Life::Fixed);
            } else {
                self.hall(&site, 5.0, Life::Fixed);
            }
        }
        for k in 0..self.random.below(3) {
            let silo = yard.part(20.0 - 7.0 * k as f32, 20.0, 2.6, 2.6);
            if self.free(&silo, 0.3) {
                self.take(&silo);
                self.solid(
                    &silo,
                    0.0,
                    11.0,
                    Roof::Round(0.9),
                    Finish::Plain,
                    [196, 198, 196],
                    [180; 3],
                    Life::Fixed,
                );
            }
        }
        self.garden_trees(&block.outline, 22);
        self.strew(&block.outline, 60, 1.6);
    }

    fn greenhouses(&mut self, block: &Block) {
        let frame = block.outline.frame();
        self.parcel(Cover::Dirt, block.outline.clone(), frame.along, 5);
        let across = left_of(frame.along);
        let width = self.random.range(3.6, 4.8);
        let rows = ((frame.width_m - 8.0) / (width * 2.3)) as i32;
        let half = (frame.length_m * 0.5 - 6.0).min(32.0);
        for row in 0..rows {
            let v = ((row as f32 + 0.5) / rows as f32 - 0.5) * (frame.width_m - 8.0);
            let q = frame.centre + across * v;
            if block.outline.depth(q + frame.along * half) < width
                || block.outline.depth(q - frame.along * half) < width
            {
                continue;
            }
            let site = self.site(q, frame.along, V2::new(half, width));
            if self.free(&site, 0.2) {
                self.take(&site);
                let tone = 170 + self.random.below(50) as u8;
                self.solid(
                    &site,
                    0.0,
                    1.6,
                    Roof::Barrel(1.9),
                    Finish::Glass,
                    [tone, tone, tone],
                    [190; 3],
                    Life::Fixed,
                );
            }
        }
    }
}
