//! The manifest of a pack before it has levels.

use grimnet_geo::Raster;
use grimnet_net::{Model, Purpose};

use crate::error::{PackError, Result};
use crate::format::FORMAT_VERSION;
use crate::manifest::{Manifest, MapSummary, ModelSummary};
use crate::options::BuildOptions;

/// The manifest without levels and sections. Its fingerprint covers everything that determines the features of the pack.
///
/// # Errors
/// Returns an error if the map cannot be read.
pub fn new_manifest(
    raster: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
) -> Result<Manifest> {
    let spec = model.spec();
    let (width, height) = raster.size_px();
    let georeference = raster.georeference().clone();
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let json = |e: serde_json::Error| {
        PackError::Options(format!("the manifest cannot be written as JSON: {e}"))
    };
    let mut manifest = Manifest {
        format_version: FORMAT_VERSION,
        created_by: concat!("grimnet-pack ", env!("CARGO_PKG_VERSION")).to_owned(),
        fingerprint: String::new(),
        mode: options.mode,
        model: ModelSummary {
            hash: model.hash().to_string(),
            preset: spec.preset.clone(),
            card: serde_json::to_value(model.card()).map_err(json)?,
            descriptor_dim: spec.descriptor_dim,
            global_dim: spec.global_len(),
            precision: model.precision().of(Purpose::Answer),
        },
        map: MapSummary {
            hash: MapSummary::hash_text(raster.content_hash()?),
            description: raster.describe(),
            size_px: [width, height],
            georeference,
            ground_resolution_m: [x_m, y_m],
        },
        options: options.clone(),
        levels: Vec::new(),
        sections: Vec::new(),
    };
    manifest.fingerprint = fingerprint_of(&manifest).map_err(json)?;
    Ok(manifest)
}

/// Raised where the same map, network and options give other contents: packs of before are built again.
const CONTENTS_REVISION: u32 = 2;

/// Of all but the map's description: it has the name of the file, and a renamed map is the same map.
fn fingerprint_of(manifest: &Manifest) -> serde_json::Result<String> {
    let mut nameless = manifest.clone();
    nameless.map.description.clear();
    let all = serde_json::to_vec(&(CONTENTS_REVISION, nameless))?;
    Ok(blake3::hash(&all).to_hex().to_string())
}
