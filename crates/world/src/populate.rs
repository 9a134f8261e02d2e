//! Fills the plan of a world with objects: buildings, trees, cars, water, courts.

mod blocks;
mod builder;
mod clutter;
mod farmland;
mod green;
mod houses;
mod occupancy;
mod parcels;
mod railway;
mod roofs;
mod site;
mod terraces;
mod traffic;
mod water;
mod works;

use nalgebra::Vector2;

use crate::config::WorldConfig;
use crate::cover::{Cover, Patch};
use crate::ground::Ground;
use crate::layout::{Block, District, Layout, Town, Zone};
use crate::random::Stream;
use crate::solid::Solid;
use crate::tree::Tree;
use crate::warp::Warp;
use builder::{Builder, STYLES};
use occupancy::{Holder, Occupancy};

type V2 = Vector2<f32>;

/// The generated ground and objects.
pub(crate) struct Populated {
    pub(crate) ground: Ground,
    pub(crate) solids: Vec<Solid>,
    pub(crate) trees: Vec<Tree>,
}

/// Worlds are placed within a square of this side in the ground's noise; beyond it, single precision would become visible.
const SOILS_M: f32 = 4096.0;

/// Generates everything in the square from `low` to `high` along both axes, metres.
pub(crate) fn populate(
    config: &WorldConfig,
    low: f32,
    high: f32,
    random: &mut Stream,
) -> Populated {
    let size = config.size_m as f32;
    let warp = Warp::new(
        low - 80.0,
        high + 80.0,
        0.05 + 0.16 * config.bend,
        &mut random.fork(1),
    );
    let mut soil = Stream::new(config.seed).fork(5);
    let soil_m = V2::new(soil.range(0.0, SOILS_M), soil.range(0.0, SOILS_M));
    let mut plan = random.fork(2);
    let town = Town {
        middle: V2::new(plan.range(0.3, 0.7), plan.range(0.3, 0.7)) * size,
        // A disc of this radius covers about the urban share of the map.
        radius_m: (config.urban / std::f32::consts::PI).sqrt() * size * 1.12 + 1.0,
    };
    let layout = Layout::new(low - 60.0, high + 60.0, town, &mut plan);
    let style = plan.pick(&STYLES);
    let Layout {
        districts,
        roads,
        blocks,
    } = layout;
    let parcels = districts.iter().map(ground_of).collect();
    let side = (high - low) as usize + 1;
    let mut builder = Builder {
        ground: Ground::new(low, high, warp, soil_m, roads, Vec::new()),
        solids: Vec::new(),
        trees: Vec::new(),
        patches: Vec::new(),
        parcels,
        occupancy: Occupancy {
            low,
            side,
            cells: vec![Holder::Nothing; side * side],
        },
        style,
        random: random.fork(3),
    };
    builder.mark_roads();
    builder.add_railway(low, high);
    builder.add_waters(low, high);
    for (i, block) in blocks.iter().enumerate() {
        builder.random = random.fork(100 + i as u64);
        builder.fill(block);
    }
    builder.random = random.fork(4);
    builder.add_traffic();
    builder.add_street_trees();
    let Builder {
        ground,
        solids,
        trees,
        patches,
        parcels,
        ..
    } = builder;
    let Ground { warp, roads, .. } = ground;
    let mut ground = Ground::new(low, high, warp, soil_m, roads, parcels);
    ground.set_patches(low, high, patches);
    Populated {
        ground,
        solids,
        trees,
    }
}

/// The ground of a district under its blocks.
fn ground_of(district: &District) -> Patch {
    let axis = district.outline.frame().along;
    let cover = match district.zone {
        Zone::Fields | Zone::Meadow | Zone::Orchard | Zone::Village => Cover::Meadow,
        Zone::Forest => Cover::ForestFloor,
        Zone::Centre | Zone::OldTown => Cover::Concrete,
        Zone::Industry => Cover::Asphalt,
        _ => Cover::Lawn,
    };
    Patch::convex(cover, district.outline.clone(), axis, 0, district.seed)
}

impl Builder {
    /// Builds what belongs to the zone of a block.
    fn fill(&mut self, block: &Block) {
        match block.zone {
            Zone::Centre => self.perimeter_block(block),
            Zone::OldTown => self.old_town(block),
            Zone::Terraces => self.terraces(block),
            Zone::Suburb | Zone::Village => self.detached(block),
            Zone::Apartments => self.apartments(block),
            Zone::Industry => self.works(block),
            Zone::Park => self.park(block),
            Zone::Sports => self.sports(block),
            Zone::Fields => self.field(block),
            Zone::Forest => self.forest(block),
            Zone::Orchard => self.orchard(block),
            Zone::Meadow => self.pasture(block),
        }
    }
}
