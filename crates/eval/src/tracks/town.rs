//! The procedural town that is flown over, and where on the globe it is.

use grimnet_geo::LonLat;
use grimnet_world::{Placement, World, WorldError};

/// A world with its place.
#[derive(Debug)]
pub struct Town {
    /// The world.
    pub world: World,
    /// Where it is.
    pub placement: Placement,
}

impl Town {
    /// Longitude and latitude of a point of the world, metres.
    ///
    /// # Errors
    /// The point is outside of the projection.
    pub fn lonlat(&self, world_m: [f64; 2]) -> Result<LonLat, WorldError> {
        let [lon_deg, lat_deg] = self.placement.lonlat_from_world(world_m)?;
        Ok(LonLat::new(lon_deg, lat_deg))
    }

    /// The point of the world at a longitude and latitude, metres.
    ///
    /// # Errors
    /// As [`Town::lonlat`].
    pub fn world_m(&self, lonlat: LonLat) -> Result<[f64; 2], WorldError> {
        self.placement
            .world_from_lonlat([lonlat.lon_deg, lonlat.lat_deg])
    }
}
