//! Buildings from their footprint: walls, roof and objects on the roof.

use nalgebra::Vector2;

use super::builder::Builder;
use super::site::Site;
use crate::convex::left_of;
use crate::solid::{Finish, Life, Roof};

type V2 = Vector2<f32>;

const WALLS: [[u8; 3]; 7] = [
    [206, 198, 184],
    [188, 176, 158],
    [214, 208, 200],
    [168, 128, 108],
    [196, 178, 140],
    [160, 156, 150],
    [218, 210, 190],
];

const SHEETS: [[u8; 3]; 9] = [
    [196, 198, 200],
    [168, 172, 176],
    [120, 138, 158],
    [104, 130, 118],
    [166, 92, 78],
    [212, 208, 198],
    [142, 140, 136],
    [84, 112, 150],
    [184, 150, 128],
];

impl Builder {
    pub(super) fn wall_colour(&mut self) -> [u8; 3] {
        let base = self.random.pick(&WALLS);
        self.shifted(base, 12.0)
    }

    pub(super) fn tile_colour(&mut self) -> [u8; 3] {
        let base = self.random.pick(&self.style.tiles.clone());
        self.shifted(base, 14.0)
    }

    pub(super) fn sheet_colour(&mut self) -> [u8; 3] {
        let base = self.random.pick(&SHEETS);
        self.shifted(base, 14.0)
    }

    fn shifted(&mut self, base: [u8; 3], by: f32) -> [u8; 3] {
        let all = self.random.normal() * by;
        base.map(|c| {
            (f32::from(c) + all + self.random.normal() * by * 0.16).clamp(20.0, 245.0) as u8
        })
    }

    /// A flat-roofed building with clutter on top.
    pub(super) fn flat_building(&mut self, site: &Site, height_m: f32, life: Life) {
        let finish = match self.random.below(10) {
            0..=2 => Finish::Bitumen,
            3..=5 => Finish::Gravel,
            6..=7 => Finish::Membrane,
            _ => Finish::Slab,
        };
        let roof_rgb = match finish {
            Finish::Bitumen => self.shifted([98, 96, 96], 16.0),
            Finish::Gravel => self.shifted([158, 152, 142], 14.0),
            Finish::Membrane => self.shifted([214, 212, 206], 12.0),
            _ => self.shifted([164, 148, 132], 18.0),
        };
        let wall = self.wall_colour();
        self.solid(
            site,
            0.0,
            height_m,
            Roof::Flat,
            finish,
            roof_rgb,
            wall,
            life,
        );
        self.roof_clutter(site, height_m, life);
    }

    /// Stair heads, machines, skylights, solar panels.
    pub(super) fn roof_clutter(&mut self, site: &Site, height_m: f32, life: Life) {
        let area = site.half.x * site.half.y * 4.0;
        if site.half.min() < 2.5 {
            return;
        }
        if area > 90.0 && self.random.chance(0.75) {
            let (hu, hv) = (self.random.range(1.2, 2.6), self.random.range(1.2, 2.2));
            let u = self.random.range(-0.8, 0.8) * (site.half.x - hu);
            let v = self.random.range(-0.8, 0.8) * (site.half.y - hv);
            let wall = self.wall_colour();
            let part = site.part(u, v, hu, hv);
            let rise = self.random.range(2.0, 3.4);
            self.solid(
                &part,
                height_m,
                height_m + rise,
                Roof::Flat,
                Finish::Bitumen,
                [120, 118, 116],
                wall,
                life,
            );
        }
        let machines = (area / 70.0 * self.random.range(0.2, 1.6)).min(14.0) as usize;
        for _ in 0..machines {
            let (hu, hv) = (self.random.range(0.4, 1.3), self.random.range(0.4, 1.1));
            let u = self.random.range(-0.9, 0.9) * (site.half.x - hu);
            let v = self.random.range(-0.9, 0.9) * (site.half.y - hv);
            let c = self.shifted([176, 176, 172], 30.0);
            let rise = self.random.range(0.5, 1.6);
            let roof = if self.random.chance(0.2) {
                Roof::Round(0.1)
            } else {
                Roof::Flat
            };
            let part = site.part(u, v, hu, hv);
            self.solid(
                &part,
                height_m,
                height_m + rise,
                roof,
                Finish::Plain,
                c,
                c,
                life,
            );
        }
        self.roof_panels(site, height_m, life);
    }

    /// Solar panels and skylights on a flat roof.
    fn roof_panels(&mut self, site: &Site, height_m: f32, life: Life) {
        let area = site.half.x * site.half.y * 4.0;
        if area > 120.0 && self.random.chance(0.22) {
            // Rows of solar panels on a part of the roof.
            let (hu, hv) = (site.half.x * 0.42, site.half.y * 0.8);
            let side = if self.random.chance(0.5) { 1.0 } else { -1.0 };
            let part = site.part(side * site.half.x * 0.5, 0.0, hu, hv);
            self.solid(
                &part,
                height_m,
                height_m + 0.4,
                Roof::Shed(0.15),
                Finish::Solar,
                [44, 52, 78],
                [60; 3],
                life,
            );
        }
        if area > 200.0 && self.random.chance(0.4) {
            let n = (site.half.x / 4.0) as i32;
            for i in 0..n {
                let u = (i as f32 + 0.5) / n as f32 * 1.7 - 0.85;
                let part = site.part(u * site.half.x, site.half.y * 0.35, 0.9, 0.9);
                self.solid(
                    &part,
                    height_m,
                    height_m + 0.5,
                    Roof::Hip(0.3),
                    Finish::Membrane,
                    [206, 216, 222],
                    [160; 3],
                    life,
                );
            }
        }
    }

    /// A house with a pitched roof, ridge along the longer side, perhaps with a wing and chimney.
    pub(super) fn pitched_house(&mut self, site: &Site, height_m: f32, tiles: [u8; 3], life: Life) {
        let site = if site.half.y > site.half.x {
            Site {
                axis: left_of(site.axis),
                half: V2::new(site.half.y, site.half.x),
                ..*site
            }
        } else {
            *site
        };
        let wall = self.wall_colour();
        let pitch = self.random.range(0.45, 0.85);
        let rise = site.half.y * pitch;
        let hip = self.random.chance(0.35);
        let roof = if hip {
            Roof::Hip(rise)
        } else {
            Roof::Gable(rise)
        };
        self.solid(&site, 0.0, height_m, roof, Finish::Tiles, tiles, wall, life);
        if self.random.chance(0.4) {
            // A cross wing, its ridge a little lower.
            let hu = site.half.y * self.random.range(0.5, 0.8);
            let reach = self.random.range(1.5, 3.5);
            let side = if self.random.chance(0.5) { 1.0 } else { -1.0 };
            let u = self.random.range(-0.6, 0.6) * (site.half.x - hu);
            let wing = Site {
                centre: site.at(u, side * (site.half.y * 0.5 + reach * 0.5)),
                axis: left_of(site.axis),
                half: V2::new(site.half.y * 0.5 + reach * 0.5, hu),
            };
            let roof = if hip {
                Roof::Hip(hu * pitch)
            } else {
                Roof::Gable(hu * pitch)
            };
            self.solid(&wing, 0.0, height_m, roof, Finish::Tiles, tiles, wall, life);
            self.take(&wing);
        }
        if self.random.chance(0.6) {
            let u = self.random.range(-0.7, 0.7) * site.half.x;
            let part = site.part(u, self.random.range(-0.3, 0.3) * site.half.y, 0.45, 0.35);
            let top = height_m + rise + 0.7;
            self.solid(
                &part,
                height_m,
                top,
                Roof::Flat,
                Finish::Plain,
                [130, 96, 84],
                [150, 104, 90],
                life,
            );
        }
        if self.random.chance(0.3) {
            // Skylights or panels lie on one side of the roof.
            let v = if self.random.chance(0.5) { 0.5 } else { -0.5 };
            let tilt = if v > 0.0 { -1.0 } else { 1.0 };
            let part = Site {
                centre: site.at(self.random.range(-0.3, 0.3) * site.half.x, v * site.half.y),
                axis: site.axis * if tilt > 0.0 { 1.0 } else { -1.0 },
                half: V2::new(site.half.x * 0.4, site.half.y * 0.32),
            };
            let mid = height_m + rise * 0.5 + 0.12;
            let drop = rise * 0.32;
            self.solid(
                &part,
                mid - drop - 0.4,
                mid - drop,
                Roof::Shed(2.0 * drop),
                Finish::Solar,
                [42, 50, 76],
                [60; 3],
                life,
            );
        }
    }

    /// A hall with a sheet roof.
    pub(super) fn hall(&mut self, site: &Site, height_m: f32, life: Life) {
        let sheet = self.sheet_colour();
        let wall = self.sheet_colour();
        let rise = site.half.y * self.random.range(0.06, 0.16);
        match self.random.below(6) {
            0 => {
                // Saw teeth with glazed north sides.
                let n = (site.half.x / 4.5).max(1.0) as i32;
                let step = site.half.x * 2.0 / n as f32;
                for i in 0..n {
                    let u = -site.half.x + (i as f32 + 0.5) * step;
                    let tooth = Site {
                        centre: site.at(u, 0.0),
                        axis: left_of(site.axis),
                        half: V2::new(site.half.y, step * 0.5),
                    };
                    self.solid(
                        &tooth,
                        0.0,
                        height_m,
                        Roof::Shed(1.8),
                        Finish::Metal,
                        sheet,
                        wall,
                        life,
                    );
                }
            }
            1 => self.solid(
                site,
                0.0,
                height_m,
                Roof::Barrel(rise * 1.5),
                Finish::Metal,
                sheet,
                wall,
                life,
            ),
            2 => self.flat_building(site, height_m, life),
            _ => {
                self.gabled_hall(site, height_m, rise, [sheet, wall], life);
            }
        }
    }

    /// A hall with a gable roof, its ridge along the longer side, sometimes with ventilators.
    fn gabled_hall(
        &mut self,
        site: &Site,
        height_m: f32,
        rise: f32,
        [sheet, wall]: [[u8; 3]; 2],
        life: Life,
    ) {
        let site = if site.half.y > site.half.x {
            Site {
                axis: left_of(site.axis),
                half: V2::new(site.half.y, site.half.x),
                ..*site
            }
        } else {
            *site
        };
        self.solid(
            &site,
            0.0,
            height_m,
            Roof::Gable(rise),
            Finish::Metal,
            sheet,
            wall,
            life,
        );
        // Ventilators along the ridge.
        if self.random.chance(0.6) {
            let n = (site.half.x / 3.0) as i32;
            for i in 0..n {
                let u = ((i as f32 + 0.5) / n as f32 * 2.0 - 1.0) * site.half.x;
                let part = site.part(u, 0.0, 0.5, 0.5);
                let top = height_m + rise + 0.6;
                self.solid(
                    &part,
                    height_m,
                    top,
                    Roof::Round(0.2),
                    Finish::Plain,
                    [150; 3],
                    [140; 3],
                    life,
                );
            }
        }
    }

    pub(super) fn house_life(&mut self) -> Life {
        if self.random.chance(0.5) {
            Life::Lasting
        } else {
            Life::Fixed
        }
    }
}
