//! The maps that the service localises on.

use std::sync::Arc;

use grimnet_geo::{LonLat, MapPx, Raster, wrap_longitude_deg};
use grimnet_locate::Localizer;
use serde::Serialize;

use crate::error::ServeError;
use crate::problem::Problem;
use crate::tile_address::zoom_of_gsd;

/// Points of the outline between two corners of the map: its edges may be curved in longitude and latitude.
const POINTS_PER_EDGE: u32 = 8;

/// Side of the smallest picture of a whole map that is served, pixels: coarser zooms would read all of the map for a few pixels.
const COARSEST_PX: f64 = 64.0;

/// Longest id of a map.
const MAX_ID_CHARACTERS: usize = 64;

/// A pack with its localiser, and the map that it was built from if that is given.
pub struct ServedMap {
    pub(crate) id: String,
    pub(crate) localizer: Arc<Localizer>,
    pub(crate) raster: Option<Arc<dyn Raster>>,
    /// Outline of the map, closed; longitudes continue over the antimeridian, and are then above 180 degrees.
    pub(crate) outline: Vec<LonLat>,
}

impl ServedMap {
    /// A map to serve. Its id is made from `name`: lower case letters, digits and hyphens.
    ///
    /// `raster` is the map that the pack of `localizer` was built from: the caller checks that. Matches are drawn for clients if
    /// the localiser keeps them ([`grimnet_locate::Options::keep_matches`]).
    ///
    /// # Errors
    /// Returns [`ServeError::Map`] if a corner of the map has no position on Earth.
    pub fn new(
        name: &str,
        localizer: impl Into<Arc<Localizer>>,
        raster: Option<Arc<dyn Raster>>,
    ) -> Result<Self, ServeError> {
        let localizer = localizer.into();
        let outline = outline(&localizer)?;
        Ok(Self {
            id: id_from(name),
            localizer,
            raster,
            outline,
        })
    }

    /// The id under which clients name the map.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// West, south, east and north, degrees. East is above 180 on a map that crosses the antimeridian.
    pub(crate) fn bounds_deg(&self) -> [f64; 4] {
        let mut bounds = [
            f64::INFINITY,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NEG_INFINITY,
        ];
        for point in &self.outline {
            bounds[0] = bounds[0].min(point.lon_deg);
            bounds[1] = bounds[1].min(point.lat_deg);
            bounds[2] = bounds[2].max(point.lon_deg);
            bounds[3] = bounds[3].max(point.lat_deg);
        }
        bounds
    }

    /// Coarsest and finest zoom of the map's tiles.
    pub(crate) fn zooms(&self) -> [u32; 2] {
        let summary = &self.localizer.pack().manifest().map;
        let [x_m, y_m] = summary.ground_resolution_m;
        let [_, south, _, north] = self.bounds_deg();
        let finest = zoom_of_gsd(x_m.min(y_m), (south + north) / 2.0);
        let long_px = summary.size_px.into_iter().max().unwrap_or(1) as f64;
        let steps = (long_px / COARSEST_PX).log2().ceil().max(0.0) as u32;
        [finest.saturating_sub(steps), finest]
    }

    /// The map, as clients see it.
    pub(crate) fn summary(&self) -> MapSummary {
        let manifest = self.localizer.pack().manifest();
        MapSummary {
            id: self.id.clone(),
            bounds_deg: self.bounds_deg(),
            outline_lon_lat_deg: self
                .outline
                .iter()
                .map(|point| [point.lon_deg, point.lat_deg])
                .collect(),
            ground_resolution_m: manifest.map.ground_resolution_m,
            has_picture: self.raster.is_some(),
            levels: self
                .localizer
                .pack()
                .levels()
                .iter()
                .map(|level| LevelSummary {
                    gsd_m: level.gsd_m(),
                    tile_m: level.tile_m(),
                    tiles: level.tile_count(),
                })
                .collect(),
            minzoom: self.zooms()[0],
            maxzoom: self.zooms()[1],
            tilejson: format!("/v1/maps/{}/tilejson.json", self.id),
        }
    }
}

impl std::fmt::Debug for ServedMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ServedMap")
            .field("id", &self.id)
            .field("has_picture", &self.raster.is_some())
            .finish_non_exhaustive()
    }
}

/// A map, as clients see it.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
#[schema(as = Map)]
pub(crate) struct MapSummary {
    /// Name of the map in requests.
    id: String,
    /// West, south, east, north, degrees. East is above 180 on a map that crosses the antimeridian.
    bounds_deg: [f64; 4],
    /// Outline of the map, closed: longitude and latitude, degrees.
    outline_lon_lat_deg: Vec<[f64; 2]>,
    /// Metres per pixel of the map at its centre, x and y.
    ground_resolution_m: [f64; 2],
    /// Whether tiles show the map; they show the outlines of the pack otherwise.
    has_picture: bool,
    /// Levels of ground resolution, finest first.
    levels: Vec<LevelSummary>,
    /// Coarsest zoom of the tiles.
    minzoom: u32,
    /// Finest zoom of the tiles that shows more than the one before.
    maxzoom: u32,
    /// Where the TileJSON of the map is.
    tilejson: String,
}

/// One level of ground resolution.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
#[schema(as = Level)]
struct LevelSummary {
    /// Metres per pixel.
    gsd_m: f64,
    /// Side of a tile, metres.
    tile_m: f64,
    /// Tiles with features.
    tiles: usize,
}

/// All maps of the service, with different ids.
#[derive(Debug)]
pub(crate) struct Maps(Vec<ServedMap>);

impl Maps {
    /// The maps in the order in which they were given. Ids that occur twice get a number.
    ///
    /// # Errors
    /// Returns [`ServeError::NoMaps`] if there are none.
    pub(crate) fn new(mut maps: Vec<ServedMap>) -> Result<Self, ServeError> {
        if maps.is_empty() {
            return Err(ServeError::NoMaps);
        }
        let mut taken = std::collections::HashSet::new();
        for map in &mut maps {
            let numbered = (2..).map(|number| format!("{}-{number}", map.id));
            let free = std::iter::once(map.id.clone())
                .chain(numbered)
                .find(|id| !taken.contains(id));
            map.id = free.unwrap_or_default();
            taken.insert(map.id.clone());
        }
        Ok(Self(maps))
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &ServedMap> {
        self.0.iter()
    }

    /// The map `id`.
    ///
    /// # Errors
    /// Status 404 if there is no such map.
    pub(crate) fn get(&self, id: &str) -> Result<&ServedMap, Problem> {
        self.0.iter().find(|map| map.id == id).ok_or_else(|| {
            Problem::not_found(format!(
                "there is no map {id:?}; the maps are {}",
                self.ids()
            ))
        })
    }

    /// The map `id`; without an id the only one.
    ///
    /// # Errors
    /// Status 404 if there is no such map, 422 if there are several and none is named.
    pub(crate) fn get_or_only(&self, id: Option<&str>) -> Result<&ServedMap, Problem> {
        match (id, &self.0[..]) {
            (Some(id), _) => self.get(id),
            (None, [only]) => Ok(only),
            (None, _) => Err(Problem::bad_value(format!(
                "no map is named; there are several, give one of them as `map`: {}",
                self.ids()
            ))),
        }
    }

    fn ids(&self) -> String {
        let ids: Vec<&str> = self.0.iter().map(|map| map.id.as_str()).collect();
        ids.join(", ")
    }
}

/// The outline of the map, clockwise from the top left corner, closed.
fn outline(localizer: &Localizer) -> Result<Vec<LonLat>, ServeError> {
    let map = &localizer.pack().manifest().map;
    let [width, height] = map.size_px.map(|side| side as f64);
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
    let mut points: Vec<LonLat> = Vec::new();
    let mut add = |x: f64, y: f64| -> Result<(), ServeError> {
        let mut point = map
            .georeference
            .lonlat_from_map_px(MapPx::new(x * width, y * height))?;
        if let Some(first) = points.first() {
            point.lon_deg = first.lon_deg + wrap_longitude_deg(point.lon_deg - first.lon_deg);
        }
        points.push(point);
        Ok(())
    };
    for pair in corners.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        for step in 0..POINTS_PER_EDGE {
            let share = f64::from(step) / f64::from(POINTS_PER_EDGE);
            add(
                from.0 + (to.0 - from.0) * share,
                from.1 + (to.1 - from.1) * share,
            )?;
        }
    }
    add(0.0, 0.0)?;
    begin_in_the_west(&mut points);
    Ok(points)
}

/// Turns an outline that reaches over -180 degrees by 360: then it is over 180 that its longitudes continue.
fn begin_in_the_west(outline: &mut [LonLat]) {
    if outline.iter().any(|point| point.lon_deg < -180.0) {
        for point in outline {
            point.lon_deg += 360.0;
        }
    }
}

/// Lower case letters, digits and single hyphens.
fn id_from(name: &str) -> String {
    let mut id = String::new();
    for c in name.chars().flat_map(char::to_lowercase) {
        if c.is_ascii_alphanumeric() {
            id.push(c);
        } else if !id.is_empty() && !id.ends_with('-') {
            id.push('-');
        }
        if id.len() >= MAX_ID_CHARACTERS {
            break;
        }
    }
    let id = id.trim_end_matches('-');
    if id.is_empty() {
        "map".to_owned()
    } else {
        id.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_begin_in_the_west() {
        let longitudes = |of: [f64; 3]| {
            let mut outline = of.map(|lon_deg| LonLat::new(lon_deg, -17.0));
            begin_in_the_west(&mut outline);
            outline.map(|point| point.lon_deg)
        };
        assert_eq!(longitudes([-179.5, -180.5, -180.0]), [180.5, 179.5, 180.0]);
        for kept in [[179.5, 180.5, 180.0], [-180.0, -179.5, -179.0]] {
            assert_eq!(longitudes(kept), kept);
        }
    }

    #[test]
    fn ids_fit_into_addresses() {
        assert_eq!(id_from("Town 2024_v1"), "town-2024-v1");
        assert_eq!(id_from("../../etc/passwd"), "etc-passwd");
        assert_eq!(id_from("城"), "map");
        assert_eq!(id_from(&"a".repeat(200)).len(), MAX_ID_CHARACTERS);
    }
}
