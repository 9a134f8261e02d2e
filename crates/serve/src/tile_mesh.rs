//! Where the pixels of a tile lie on a map.

use grimnet_geo::{GeoError, Georeference, MapPx};

use crate::tile_address::{TILE_SIDE_PX, TileAddress};

/// Distance of the nodes that are transformed exactly, pixels. Between them positions are interpolated: at zoom 10, where a pixel
/// is 150 m wide, the curvature of 32 pixels moves a point by less than a thousandth of a pixel.
const STEP_PX: u32 = 32;

/// Nodes on a side.
const NODES: usize = (TILE_SIDE_PX / STEP_PX) as usize + 1;

/// Map pixels of a grid of points of one tile.
pub(crate) struct TileMesh {
    nodes: [[MapPx; NODES]; NODES],
}

impl TileMesh {
    /// The mesh of a tile on a map.
    ///
    /// # Errors
    /// Returns an error if the map's projection does not cover the tile.
    pub(crate) fn new(tile: TileAddress, georeference: &Georeference) -> Result<Self, GeoError> {
        let mut nodes = [[MapPx::new(0.0, 0.0); NODES]; NODES];
        for (row, line) in nodes.iter_mut().enumerate() {
            for (column, node) in line.iter_mut().enumerate() {
                let at = |index: usize| (index as u32 * STEP_PX) as f64;
                *node = georeference.map_px_from_lonlat(tile.lonlat(at(column), at(row)))?;
            }
        }
        Ok(Self { nodes })
    }

    /// The map pixel under a point of the tile, pixels from its top left corner.
    pub(crate) fn at(&self, right_px: f64, down_px: f64) -> MapPx {
        let cell = |along_px: f64| {
            let along = along_px / f64::from(STEP_PX);
            let index = (along as usize).min(NODES - 2);
            (index, along - index as f64)
        };
        let ((column, right), (row, down)) = (cell(right_px), cell(down_px));
        let mix = |a: MapPx, b: MapPx, share: f64| {
            MapPx::new(a.x + (b.x - a.x) * share, a.y + (b.y - a.y) * share)
        };
        let line = |row: usize| mix(self.nodes[row][column], self.nodes[row][column + 1], right);
        mix(line(row), line(row + 1), down)
    }

    /// Least and largest column and row of the map in the tile: `[x, y]` each.
    pub(crate) fn bounds(&self) -> [[f64; 2]; 2] {
        let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for node in self.nodes.iter().flatten() {
            for (axis, along) in [node.x, node.y].into_iter().enumerate() {
                bounds[0][axis] = bounds[0][axis].min(along);
                bounds[1][axis] = bounds[1][axis].max(along);
            }
        }
        bounds
    }

    /// Map pixels per pixel of the tile: the least of both directions in its middle.
    pub(crate) fn map_px_per_px(&self) -> f64 {
        let middle = f64::from(TILE_SIDE_PX) / 2.0;
        let centre = self.at(middle, middle);
        let along = |right: f64, down: f64| {
            let next = self.at(middle + right, middle + down);
            (next.x - centre.x).hypot(next.y - centre.y)
        };
        along(1.0, 0.0).min(along(0.0, 1.0))
    }
}
