//! The ground: which road, patch or district lies at a point.

use nalgebra::Vector2;

use crate::bucket_grid::BucketGrid;
use crate::colour::Rgb;
use crate::cover::{Cover, Inside, Patch};
use crate::ground_noise::{GroundNoise, specks};
use crate::look::Season;
use crate::road::{Road, road_surface};
use crate::texture::{GroundPoint, patch_albedo};
use crate::warp::Warp;

type V2 = Vector2<f32>;

/// Rank at and above which a patch lies over the roads.
pub(crate) const OVER_ROADS: u8 = 100;

/// Colour and edge identity of a ground point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroundSurface {
    pub(crate) albedo: Rgb,
    pub(crate) id: u32,
}

#[derive(Debug)]
pub(crate) struct Ground {
    pub(crate) warp: Warp,
    /// Where in the endless noise this world lies, metres: no two worlds have the same soil.
    soil_m: V2,
    pub(crate) roads: Vec<Road>,
    road_grid: BucketGrid,
    /// Parcels and districts, in layout coordinates.
    parcels: Vec<Patch>,
    parcel_grid: BucketGrid,
    /// Courts, pools, rivers: in world coordinates.
    patches: Vec<Patch>,
    patch_grid: BucketGrid,
}

impl Ground {
    pub(crate) fn new(
        low: f32,
        high: f32,
        warp: Warp,
        soil_m: V2,
        roads: Vec<Road>,
        parcels: Vec<Patch>,
    ) -> Self {
        // The warp moves points by tens of metres; the layout grids reach further out.
        let (l, h) = (low - 64.0, high + 64.0);
        Self {
            road_grid: BucketGrid::build(l, h, &roads),
            parcel_grid: BucketGrid::build(l, h, &parcels),
            warp,
            soil_m,
            roads,
            parcels,
            patches: Vec::new(),
            patch_grid: BucketGrid::build(low, low, &[] as &[Patch]),
        }
    }

    pub(crate) fn set_patches(&mut self, low: f32, high: f32, patches: Vec<Patch>) {
        self.patch_grid = BucketGrid::build(low, high, &patches);
        self.patches = patches;
    }

    /// The topmost of the listed patches that holds the point.
    #[inline]
    fn topmost<'a>(patches: &'a [Patch], near: &[u32], p: V2) -> Option<(&'a Patch, Inside)> {
        let mut best: Option<(&Patch, Inside)> = None;
        for &i in near {
            let patch = &patches[i as usize];
            if best.as_ref().is_some_and(|(b, _)| b.rank > patch.rank) {
                continue;
            }
            if let Some(inside) = patch.inside(p)
                && best
                    .as_ref()
                    .is_none_or(|(b, at)| patch.rank > b.rank || inside.depth > at.depth)
            {
                best = Some((patch, inside));
            }
        }
        best
    }

    /// Colour at a world point for pixels of `pixel_m` on the ground.
    #[inline]
    pub(crate) fn surface(&self, p: V2, season: Season, pixel_m: f32) -> GroundSurface {
        let soil = p + self.soil_m;
        let noise = GroundNoise::at(soil, pixel_m);
        let patch = Self::topmost(&self.patches, self.patch_grid.at(p), p);
        let colour_of = |patch: &Patch, at: &Inside, q: V2| {
            let (albedo, kind) = patch_albedo(&GroundPoint {
                patch,
                at,
                p: q,
                noise: &noise,
                season,
                pixel_m,
            });
            let strength = match patch.cover {
                Cover::Water | Cover::Pool | Cover::Court | Cover::Track | Cover::Pitch => 0.0,
                Cover::Crop | Cover::Orchard => 0.12,
                _ => 0.24,
            };
            let litter = if strength > 0.0 {
                specks(soil, strength)
            } else {
                1.0
            };
            GroundSurface {
                albedo: albedo * litter,
                id: kind ^ (patch.seed << 8),
            }
        };
        if let Some((patch, at)) = &patch
            && patch.rank >= OVER_ROADS
        {
            return colour_of(patch, at, p);
        }
        let q = self.warp.layout_from_world(p);
        if let Some(road) = road_surface(&self.roads, self.road_grid.at(q), q, &noise, season) {
            return GroundSurface {
                albedo: road.albedo * specks(soil, 0.2),
                id: road.id,
            };
        }
        if let Some((patch, at)) = &patch {
            return colour_of(patch, at, p);
        }
        if let Some((parcel, at)) = Self::topmost(&self.parcels, self.parcel_grid.at(q), q) {
            return colour_of(parcel, &at, q);
        }
        let meadow = Patch::rectangle(Cover::Meadow, p, V2::x(), V2::repeat(1.0), 0, 0);
        let at = Inside {
            depth: 1.0,
            local: p,
        };
        colour_of(&meadow, &at, p)
    }

    /// What covers a point, roads apart.
    pub(crate) fn cover(&self, p: V2) -> Option<Cover> {
        let parcel = || {
            let q = self.warp.layout_from_world(p);
            Self::topmost(&self.parcels, self.parcel_grid.at(q), q)
        };
        Self::topmost(&self.patches, self.patch_grid.at(p), p)
            .or_else(parcel)
            .map(|(patch, _)| patch.cover)
    }

    /// Whether the point lies on a carriageway or pavement.
    pub(crate) fn on_road(&self, p: V2, margin_m: f32) -> bool {
        let q = self.warp.layout_from_world(p);
        self.road_grid.at(q).iter().any(|&i| {
            let road = &self.roads[i as usize];
            road.beyond_kerb_m(q) < margin_m
        })
    }
}
