//! Detached houses with gardens.

use nalgebra::Vector2;

use super::builder::Builder;
use super::parcels::{front, parcels_in_rows};
use super::site::{Site, fit};
use crate::convex::{Convex, left_of};
use crate::cover::Cover;
use crate::layout::{Block, Zone};
use crate::solid::{Finish, Life, Roof};
use crate::tree::Species;

type V2 = Vector2<f32>;

impl Builder {
    pub(super) fn detached(&mut self, block: &Block) {
        if block.zone == Zone::Village && self.random.chance(0.12) {
            self.parcel(
                Cover::Graves,
                block.outline.clone(),
                block.outline.frame().along,
                5,
            );
            self.garden_trees(&block.outline, 14);
            return;
        }
        let frontage = if block.zone == Zone::Village {
            self.random.range(22.0, 30.0)
        } else {
            self.random.range(17.0, 24.0)
        };
        for parcel in parcels_in_rows(self, &block.outline, frontage, 0.12) {
            self.detached_parcel(&parcel, block.zone);
        }
    }

    fn detached_parcel(&mut self, parcel: &Convex, zone: Zone) {
        let Some(inner) = parcel.inset(0.0).filter(|p| p.area_m2() > 120.0) else {
            return;
        };
        let facing = front(parcel);
        let axis = facing.map_or_else(|| inner.frame().along, |(_, inward)| -left_of(inward));
        let cover = if self.random.chance(0.55) {
            Cover::Lawn
        } else {
            Cover::Garden
        };
        self.parcel(cover, inner.clone(), axis, 10);
        let Some((front_mid, inward)) = facing else {
            self.garden_trees(&inner, 3);
            return;
        };
        if self.random.chance(0.06) {
            // An empty lot.
            self.garden_trees(&inner, 5);
            return;
        }
        let setback = self.random.range(4.0, 8.0);
        let half = V2::new(self.random.range(4.5, 7.5), self.random.range(4.0, 5.6));
        let along = -left_of(inward);
        let middle = front_mid + inward * (setback + half.y) + along * self.random.range(-2.0, 2.0);
        let life = self.house_life();
        let Some((centre, half)) = inner
            .inset(1.2)
            .and_then(|p| fit(&p, middle, along, half))
            .filter(|(_, h)| h.min() > 2.6)
        else {
            self.garden_trees(&inner, 4);
            return;
        };
        let site = self.site(centre, along, half);
        if !self.free(&site, 0.5) {
            self.garden_trees(&inner, 4);
            return;
        }
        self.take(&site);
        let height = if self.random.chance(0.5) { 3.2 } else { 5.8 } + self.random.range(-0.3, 0.6);
        let modern = self.random.chance(self.style.flat * 0.6);
        if modern {
            self.flat_building(&site, height, life);
        } else {
            let tiles = self.tile_colour();
            self.pitched_house(&site, height, tiles, life);
        }
        let toward = self.driveway(&site, front_mid);
        let back = -toward.signum();
        self.terrace(&site, back);
        if self
            .random
            .chance(if zone == Zone::Suburb { 0.22 } else { 0.08 })
        {
            self.swimming_pool(&site, back, &inner);
        }
        if self.random.chance(0.5) {
            self.shed(&site, back, &inner);
        }
        if self.random.chance(0.35) {
            self.hedge_round(&inner);
        } else {
            self.fences(&inner, 0.5);
        }
        self.strew(&inner, 7, 1.2);
        let n = 2 + self.random.below(5);
        self.garden_trees(&inner, n);
    }

    /// A driveway from the street beside a house, often with a garage and a car. Returns how far the street is along the
    /// house's second axis, metres.
    fn driveway(&mut self, site: &Site, front_mid: V2) -> f32 {
        let side = if self.random.chance(0.5) { 1.0 } else { -1.0 };
        let street = self.ground.warp.world_from_layout(front_mid);
        let depth = (site.centre - street).dot(&left_of(site.axis)).abs();
        let toward = (street - site.centre).dot(&left_of(site.axis));
        let drive = Site {
            centre: site.at(side * (site.half.x + 2.2), toward * 0.5),
            axis: site.axis,
            half: V2::new(self.random.range(1.5, 2.6), depth * 0.5 + 1.0),
        };
        let surface =
            self.random
                .pick(&[Cover::Concrete, Cover::Slabs, Cover::Asphalt, Cover::Gravel]);
        self.pave(surface, &drive, 20);
        if self.random.chance(0.55) {
            let garage = site.part(side * (site.half.x + 2.2), -toward.signum() * 0.8, 1.7, 2.9);
            if self.free(&garage, 0.0) {
                self.take(&garage);
                let wall = self.wall_colour();
                let roof = self.tile_colour();
                let top = if self.random.chance(0.6) {
                    Roof::Flat
                } else {
                    Roof::Gable(1.0)
                };
                let finish = if top == Roof::Flat {
                    Finish::Bitumen
                } else {
                    Finish::Tiles
                };
                self.solid(&garage, 0.0, 2.7, top, finish, roof, wall, Life::Fixed);
            }
        }
        let parked = drive.part(0.0, toward.signum() * depth * 0.18, 1.0, 2.3);
        self.car(parked.centre, left_of(drive.axis), 0.6);
        toward
    }

    /// A paved terrace on the side `back` (1 or -1) of a house.
    fn terrace(&mut self, site: &Site, back: f32) {
        let half = site.half;
        let terrace = site.part(
            self.random.range(-2.0, 2.0),
            back * (half.y + 1.6),
            2.8,
            1.6,
        );
        if self.random.chance(0.7) {
            self.pave(Cover::Slabs, &terrace, 21);
        }
    }

    fn swimming_pool(&mut self, site: &Site, back: f32, inner: &Convex) {
        let half = site.half;
        let pool = site.part(
            self.random.range(-3.0, 3.0),
            back * (half.y + 8.0),
            self.random.range(3.0, 5.0),
            self.random.range(1.8, 2.6),
        );
        if self.free(&pool, 0.5)
            && inner.depth(self.ground.warp.layout_from_world(pool.centre)) > 3.0
        {
            let rim = Site {
                half: pool.half + V2::repeat(1.2),
                ..pool
            };
            self.pave(Cover::Slabs, &rim, 22);
            self.pave(Cover::Pool, &pool, 23);
            self.take(&pool);
        }
    }

    fn shed(&mut self, site: &Site, back: f32, inner: &Convex) {
        let half = site.half;
        let shed = site.part(
            self.random.range(-1.0, 1.0) * half.x,
            back * (half.y + self.random.range(7.0, 13.0)),
            self.random.range(1.0, 2.0),
            self.random.range(1.0, 1.6),
        );
        let place = self.ground.warp.layout_from_world(shed.centre);
        if inner.depth(place) > 1.8 && self.free(&shed, 0.3) {
            self.take(&shed);
            let roof = self.sheet_colour();
            self.solid(
                &shed,
                0.0,
                2.1,
                Roof::Gable(0.6),
                Finish::Wood,
                roof,
                [120, 96, 74],
                Life::Fixed,
            );
        }
    }

    /// Trees and shrubs scattered over a layout polygon.
    pub(super) fn garden_trees(&mut self, inner: &Convex, count: usize) {
        let (low, high) = inner.bounds();
        for _ in 0..count * 2 {
            let q = V2::new(
                self.random.range(low.x, high.x),
                self.random.range(low.y, high.y),
            );
            let shrub = self.random.chance(0.45);
            let radius = if shrub {
                self.random.range(0.6, 1.4)
            } else {
                self.random.range(1.6, 4.2)
            };
            if inner.depth(q) < radius * 0.3 {
                continue;
            }
            let p = self.ground.warp.world_from_layout(q);
            let near_house = (0..4).any(|k| {
                let a = k as f32 * std::f32::consts::FRAC_PI_2;
                self.occupancy
                    .taken(p + V2::new(a.cos(), a.sin()) * radius * 0.8)
            });
            if near_house && radius > 2.0 {
                continue;
            }
            let species = if shrub {
                Species::Shrub
            } else {
                self.any_species()
            };
            self.tree(p, radius, species);
        }
    }

    /// A low hedge inside the edges that do not face a street.
    pub(super) fn hedge_round(&mut self, inner: &Convex) {
        let n = inner.points.len();
        for i in 0..n {
            if inner.edge_half_width_m[i] > 0.0 && self.random.chance(0.7) {
                continue;
            }
            let (a, b) = (inner.points[i], inner.points[(i + 1) % n]);
            let d = b - a;
            if d.norm() < 5.0 {
                continue;
            }
            let dir = d.normalize();
            let mid = (a + b) * 0.5 + left_of(dir) * 0.6;
            let site = self.site(mid, dir, V2::new(d.norm() * 0.5 - 0.8, 0.45));
            if self.free(&site, 0.0) {
                self.solid(
                    &site,
                    0.0,
                    1.6,
                    Roof::Flat,
                    Finish::Hedge,
                    [62, 84, 44],
                    [50, 70, 38],
                    Life::Fixed,
                );
            }
        }
    }
}
