//! What files beside a picture say of it.

use crate::Affine;
use crate::content_hash::ContentValues;
use crate::stated_crs::StatedCrs;

/// Values of a world file and of GDAL's `.aux.xml`: those that there are, or those that a map takes.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct SidecarValues {
    /// Transform from pixels, at pixel corners.
    pub affine: Option<Affine>,
    pub crs: StatedCrs,
    /// The value of pixels without data.
    pub nodata: Option<f64>,
}

impl SidecarValues {
    /// Adds them to a map's content.
    pub fn add_to(&self, values: &mut ContentValues) {
        if let Some(affine) = self.affine {
            values.add_numbers("transform", &affine.to_gdal());
        }
        if let Some(crs) = self.crs.known() {
            values.add_text("crs", crs.definition());
        }
        if let Some(nodata) = self.nodata {
            values.add_numbers("nodata", &[nodata]);
        }
    }
}
