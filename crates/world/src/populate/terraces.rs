//! Terraced houses.

use nalgebra::Vector2;

use super::builder::Builder;
use super::parcels::{front, parcels_in_rows};
use super::site::Site;
use crate::convex::left_of;
use crate::cover::Cover;
use crate::layout::Block;
use crate::solid::{Finish, Life, Roof};

type V2 = Vector2<f32>;

impl Builder {
    pub(super) fn terraces(&mut self, block: &Block) {
        let frame = block.outline.frame();
        self.parcel(Cover::Lawn, block.outline.clone(), frame.along, 5);
        let tiles = self.tile_colour();
        let wall = self.wall_colour();
        let unit_m = self.random.range(5.8, 7.6);
        let depth = self.random.range(4.2, 5.2);
        let height = self.random.range(5.2, 6.4);
        let rise = depth * self.random.range(0.5, 0.8);
        for parcel in parcels_in_rows(self, &block.outline, unit_m, 0.0) {
            let Some((front_mid, inward)) = front(&parcel) else {
                self.garden_trees(&parcel, 1);
                continue;
            };
            let along = -left_of(inward);
            self.parcel(Cover::Garden, parcel.clone(), along, 6);
            let frame = parcel.frame_along(along);
            if (frame.length_m - unit_m).abs() > unit_m * 0.5 {
                self.garden_trees(&parcel, 3);
                continue;
            }
            let centre = front_mid + inward * (3.6 + depth);
            let site = self.site(centre, along, V2::new(frame.length_m * 0.5 + 0.05, depth));
            let checked = Site {
                half: site.half - V2::new(0.8, 0.2),
                ..site
            };
            if !self.free(&checked, 0.0) || parcel.depth(centre + inward * depth) < 0.3 {
                self.garden_trees(&parcel, 2);
                continue;
            }
            // Neighbours touch, so only a core is marked.
            self.take(&checked);
            let own_tiles = if self.random.chance(0.12) {
                self.tile_colour()
            } else {
                tiles
            };
            self.solid(
                &site,
                0.0,
                height,
                Roof::Gable(rise),
                Finish::Tiles,
                own_tiles,
                wall,
                Life::Fixed,
            );
            let chimney = site.part(site.half.x - 0.4, 0.0, 0.35, 0.6);
            self.solid(
                &chimney,
                height,
                height + rise + 0.9,
                Roof::Flat,
                Finish::Plain,
                [120, 84, 72],
                [140, 94, 80],
                Life::Fixed,
            );
            if self.random.chance(0.35) {
                self.lean_to(&site, front_mid, wall);
            }
            if self.random.chance(0.25) {
                let part = self.site(front_mid + inward * 1.9, along, V2::new(1.2, 1.9));
                self.pave(Cover::Slabs, &part, 20);
            }
            self.fences(&parcel, 0.6);
            self.strew(&parcel, 2, 0.9);
            self.garden_trees(&parcel, 1);
        }
    }

    /// A lean-to at the back of a terraced house whose front is at `front_mid` (layout).
    fn lean_to(&mut self, site: &Site, front_mid: V2, wall: [u8; 3]) {
        let back =
            (self.ground.warp.world_from_layout(front_mid) - site.centre).dot(&left_of(site.axis));
        let hv = self.random.range(1.2, 2.2);
        let part = site.part(
            0.6,
            -back.signum() * (site.half.y + hv),
            site.half.x * 0.6,
            hv,
        );
        let roof = self
            .random
            .pick(&[Finish::Glass, Finish::Bitumen, Finish::Tiles]);
        self.solid(
            &part,
            0.0,
            2.6,
            Roof::Flat,
            roof,
            [150, 150, 150],
            wall,
            Life::Fixed,
        );
        self.take(&part);
    }
}
