//! Dense town: perimeter blocks, old town, apartment slabs.

use nalgebra::Vector2;

use super::builder::Builder;
use super::parcels::parcels_in_rows;
use super::site::{Site, fit};
use crate::convex::{Convex, left_of};
use crate::cover::Cover;
use crate::layout::Block;
use crate::solid::{Finish, Life, Roof};

type V2 = Vector2<f32>;

impl Builder {
    pub(super) fn perimeter_block(&mut self, block: &Block) {
        let outline = &block.outline;
        let frame = outline.frame();
        let court =
            self.random
                .pick(&[Cover::Concrete, Cover::Garden, Cover::Asphalt, Cover::Slabs]);
        self.parcel(court, outline.clone(), frame.along, 5);
        let storeys = self.random.range(3.0, 6.0);
        let depth = self.random.range(5.5, 7.5);
        let n = outline.points.len();
        for i in 0..n {
            let (a, b) = (outline.points[i], outline.points[(i + 1) % n]);
            let length = (b - a).norm();
            if length < 8.0 {
                continue;
            }
            let dir = (b - a) / length;
            let inward = left_of(dir);
            let units = (length / self.random.range(13.0, 20.0)).round().max(1.0) as i32;
            let width = length / units as f32;
            for k in 0..units {
                if self.random.chance(0.06) {
                    continue;
                }
                let own = depth * self.random.range(0.85, 1.15);
                let centre = a + dir * (width * (k as f32 + 0.5)) + inward * (own + 0.5);
                let site = self.site(centre, dir, V2::new(width * 0.5, own));
                let core = Site {
                    half: site.half * 0.75,
                    ..site
                };
                if !self.free(&core, 0.0) {
                    continue;
                }
                self.take(&core);
                let height = (storeys + self.random.range(-1.3, 1.3)).round().max(2.0) * 3.2 + 0.8;
                self.row_house(&site, height, own);
            }
        }
        self.courtyard(outline, depth * 2.0 + 3.0);
    }

    /// A house of a perimeter block: flat, or with a gable roof and chimneys. `half_depth_m` decides the rise of the roof.
    fn row_house(&mut self, site: &Site, height: f32, half_depth_m: f32) {
        let own = half_depth_m;
        let life = self.house_life();
        if self.random.chance(self.style.flat) {
            self.flat_building(site, height, life);
        } else {
            let tiles = self.tile_colour();
            let wall = self.wall_colour();
            let rise = own * self.random.range(0.4, 0.75);
            self.solid(
                site,
                0.0,
                height,
                Roof::Gable(rise),
                Finish::Tiles,
                tiles,
                wall,
                life,
            );
            for _ in 0..self.random.below(4) {
                let u = self.random.range(-0.85, 0.85) * site.half.x;
                let part = site.part(u, self.random.range(-0.5, 0.5) * own, 0.5, 0.4);
                let top = height + rise + 0.6;
                self.solid(
                    &part,
                    height,
                    top,
                    Roof::Flat,
                    Finish::Plain,
                    [128, 100, 90],
                    [150, 116, 100],
                    life,
                );
            }
        }
    }

    /// The yard inside a perimeter block: back buildings, garages, trees, parked cars.
    fn courtyard(&mut self, outline: &Convex, houses_m: f32) {
        let Some(yard) = outline.inset(houses_m).filter(|y| y.area_m2() > 150.0) else {
            return;
        };
        let f = yard.frame();
        for _ in 0..(yard.area_m2() / 220.0) as usize {
            let q = f.centre
                + f.along * (self.random.range(-0.45, 0.45) * f.length_m)
                + left_of(f.along) * (self.random.range(-0.45, 0.45) * f.width_m);
            let half = V2::new(self.random.range(3.0, 7.0), self.random.range(2.5, 4.5));
            if yard.depth(q) < 1.0 {
                continue;
            }
            let site = self.site(q, f.along, half);
            if self.free(&site, 1.0) {
                self.take(&site);
                if self.random.chance(0.5) {
                    let sheet = self.sheet_colour();
                    self.solid(
                        &site,
                        0.0,
                        3.0,
                        Roof::Shed(0.6),
                        Finish::Metal,
                        sheet,
                        [150; 3],
                        Life::Lasting,
                    );
                } else {
                    let height = self.random.range(3.5, 9.0);
                    self.flat_building(&site, height, Life::Lasting);
                }
            }
        }
        self.strew(&yard, (yard.area_m2() / 40.0) as usize, 1.4);
        self.garden_trees(&yard, (yard.area_m2() / 110.0) as usize);
    }

    pub(super) fn old_town(&mut self, block: &Block) {
        let frame = block.outline.frame();
        self.parcel(Cover::Slabs, block.outline.clone(), frame.along, 5);
        let frontage = self.random.range(8.0, 12.5);
        for parcel in parcels_in_rows(self, &block.outline, frontage, 0.25) {
            if self.random.chance(0.07) {
                self.parcel(Cover::Garden, parcel.clone(), frame.along, 6);
                self.garden_trees(&parcel, 3);
                continue;
            }
            let f = parcel.frame_along(frame.along);
            // Built nearly all over: a front house and one or two behind it.
            let pieces = if f.width_m > 16.0 { 2 } else { 1 };
            for k in 0..pieces {
                let across = left_of(f.along);
                let share = f.width_m / pieces as f32;
                let q = f.centre + across * ((k as f32 + 0.5) * share - f.width_m * 0.5);
                let half = V2::new(f.length_m * 0.5, share * self.random.range(0.38, 0.5));
                let Some((centre, half)) = fit(&parcel, q, f.along, half) else {
                    continue;
                };
                if half.min() < 2.0 {
                    continue;
                }
                let site = self.site(centre, f.along, half);
                let core = Site {
                    half: half * 0.7,
                    ..site
                };
                if !self.free(&core, 0.0) {
                    continue;
                }
                self.take(&core);
                let life = self.house_life();
                let height = self.random.range(1.0, 4.4).round().max(1.0) * 3.1 + 0.5;
                match self.random.below(10) {
                    0..=2 => {
                        let sheet = self.sheet_colour();
                        let wall = self.wall_colour();
                        let roof = if self.random.chance(0.5) {
                            Roof::Gable(half.y * 0.3)
                        } else {
                            Roof::Shed(0.9)
                        };
                        self.solid(&site, 0.0, height, roof, Finish::Metal, sheet, wall, life);
                    }
                    3..=5 => self.flat_building(&site, height, life),
                    _ => {
                        let tiles = self.tile_colour();
                        self.pitched_house(&site, height, tiles, life);
                    }
                }
            }
        }
    }

    pub(super) fn apartments(&mut self, block: &Block) {
        let frame = block.outline.frame();
        self.parcel(Cover::Lawn, block.outline.clone(), frame.along, 5);
        let Some(inner) = block.outline.inset(6.0) else {
            return;
        };
        let f = inner.frame();
        let across = left_of(f.along);
        let slab_depth = self.random.range(5.5, 7.5);
        let spacing = self.random.range(30.0, 40.0);
        let rows = (f.width_m / spacing).floor().max(1.0) as i32;
        let storeys = self.random.range(3.0, 9.0).round();
        let point_blocks = self.random.chance(0.3);
        for row in 0..rows {
            let v = ((row as f32 + 0.5) / rows as f32 - 0.5) * f.width_m;
            let length = if point_blocks {
                11.0
            } else {
                self.random.range(18.0, 32.0)
            };
            let n = (f.length_m / (length * 2.0 + 14.0)).floor().max(1.0) as i32;
            for k in 0..n {
                let u = ((k as f32 + 0.5) / n as f32 - 0.5) * f.length_m;
                let q = f.centre + f.along * u + across * v;
                let hv = if point_blocks { 9.0 } else { slab_depth };
                let Some((centre, half)) = fit(&inner, q, f.along, V2::new(length, hv)) else {
                    continue;
                };
                if half.min() < 4.5 {
                    continue;
                }
                let site = self.site(centre, f.along, half);
                if !self.free(&site, 1.0) {
                    continue;
                }
                self.take(&site);
                let height = (storeys + self.random.range(-1.0, 1.5)).round().max(2.0) * 3.0 + 1.2;
                let life = self.house_life();
                if self.random.chance(0.25) {
                    let tiles = self.tile_colour();
                    self.pitched_house(&site, height, tiles, life);
                } else {
                    self.flat_building(&site, height, life);
                }
                // Path along the entrances.
                let path = site.part(0.0, half.y + 3.0, half.x + 4.0, 0.9);
                self.pave(Cover::Slabs, &path, 15);
            }
            // Parking between the rows.
            if row + 1 < rows {
                let v = ((row as f32 + 1.0) / rows as f32 - 0.5) * f.width_m;
                let q = f.centre + across * v + f.along * self.random.range(-15.0, 15.0);
                let half = V2::new(self.random.range(14.0, 26.0), 8.25);
                if let Some((c, h)) = fit(&inner, q, f.along, half) {
                    let lot = self.site(c, f.along, V2::new(h.x, 8.25));
                    if self.free(&lot, 0.3) {
                        self.parking(&lot, 0.55);
                    }
                }
            }
        }
        self.garden_trees(&inner, (inner.area_m2() / 160.0) as usize);
        self.strew(&inner, (inner.area_m2() / 250.0) as usize, 1.2);
        if self.random.chance(0.6) {
            let shift = self.random.range(-30.0, 30.0);
            let spot = self.site(f.centre + f.along * shift, f.along, V2::new(7.0, 5.0));
            if self.free(&spot, 0.5) {
                self.pave(Cover::Sand, &spot, 16);
                self.take(&spot);
            }
        }
    }
}
