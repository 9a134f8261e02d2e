//! The manifest: the JSON at the end of a pack.

use grimnet_net::Precision;
use serde::{Deserialize, Serialize};

use crate::index::Index;
use crate::local_descriptors::DescriptorType;
use crate::mode::Mode;
use crate::options::BuildOptions;

/// Everything about a pack except its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The pack format, see [`crate::format::FORMAT_VERSION`].
    pub format_version: u32,
    /// Program and version that wrote it.
    pub created_by: String,
    /// blake3 (hex) over model, map, options, format and version of the program: equal for packs that are built from the same things,
    /// whatever the name of the map's file.
    pub fingerprint: String,
    /// Default or paper mode.
    pub mode: Mode,
    /// The model that computed the features.
    pub model: ModelSummary,
    /// The map that they were computed from.
    pub map: MapSummary,
    /// How it was built.
    pub options: BuildOptions,
    /// Levels of ground resolution, finest first.
    pub levels: Vec<LevelManifest>,
    /// The parts of the file.
    pub sections: Vec<Section>,
}

/// The model of a pack.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelSummary {
    /// Hash of its tensors and description, hex.
    pub hash: String,
    /// Preset of the network description (`compact`, `vgg16`, ...).
    pub preset: String,
    /// The model card.
    pub card: serde_json::Value,
    /// Numbers in a local descriptor.
    pub descriptor_dim: usize,
    /// Numbers in a tile descriptor.
    pub global_dim: usize,
    /// Precision of the network that computed them. Features of all precisions can be compared with each other.
    // Packs of earlier builds have the key `arithmetic`.
    #[serde(
        default,
        alias = "arithmetic",
        skip_serializing_if = "Precision::is_f32"
    )]
    pub precision: Precision,
}

/// The map of a pack.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapSummary {
    /// Hash of its content, hex.
    pub hash: String,
    /// Description.
    pub description: String,
    /// Width and height, map pixels.
    pub size_px: [u64; 2],
    /// Affine transform and coordinate system.
    pub georeference: grimnet_geo::Georeference,
    /// Metres per map pixel at the map's centre, x and y.
    pub ground_resolution_m: [f64; 2],
}

impl MapSummary {
    /// The content hash of a map as [`MapSummary::hash`] has it.
    #[must_use]
    pub fn hash_text(hash: [u8; 32]) -> String {
        blake3::Hash::from_bytes(hash).to_hex().to_string()
    }
}

/// One level of ground resolution.
///
/// A level pixel is a square of `gsd_m` metres on the ground at the map's centre; level pixel coordinates are
/// continuous, (0, 0) being the outer corner of the map's top-left pixel, as in the map's own pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelManifest {
    /// Ground resolution, scale factors to map pixels and size.
    pub frame: grimnet_geo::LevelFrame,
    /// Top-left corner of tile (0, 0), level pixels; negative where the map is padded.
    pub origin_px: [i64; 2],
    /// Side of a tile, level pixels.
    pub tile_px: u32,
    /// Distance between neighbouring tiles, level pixels.
    pub stride_px: u32,
    /// Side of the picture that the network sees for one tile; equal to `tile_px` if it sees level pixels.
    pub network_px: u32,
    /// Columns and rows of the tile grid, skipped tiles included.
    pub tile_grid: [u32; 2],
    /// Columns and rows of feature units: cells (one more than tiles) or, in paper mode, tiles.
    pub unit_grid: [u32; 2],
    /// Feature units along the side of a tile: 2 cells or, in paper mode, 1. The unit at the top left of a tile has the
    /// tile's column and row; neighbouring units are `stride_px` apart.
    pub units_per_tile_side: u32,
    /// Tiles with a descriptor.
    pub tiles: u64,
    /// Tiles left out because less than a quarter of what lies on the map has data that is not black.
    pub tiles_skipped: u64,
    /// Feature units computed.
    pub units: u64,
    /// Feature units left out because too little of them has data that is not black: of a cell less than 5 %, of a tile in paper mode
    /// less than a quarter.
    pub units_skipped: u64,
    /// Keypoints in all units.
    pub keypoints: u64,
    /// Maximum number of keypoints of a unit.
    pub keypoints_per_unit: u32,
    /// How descriptors are stored.
    #[serde(default, skip_serializing_if = "DescriptorType::is_int8")]
    pub descriptor_type: DescriptorType,
    /// int8 quantisation scale of local descriptors.
    pub descriptor_scale: f32,
    /// Tiles that adapted statistics were computed from; 0 if the model's own were used.
    pub adapted_from_tiles: u32,
    /// How tile descriptors are searched.
    pub index: Index,
    /// Why the index is not the one that could be expected; empty if it is.
    pub index_note: String,
    /// Share of the ten exact nearest neighbours (of sampled tiles, themselves left out) that an IVF-PQ index finds.
    pub index_recall_at_10: Option<f64>,
    /// The index of the level's keypoints, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keypoint_index: Option<KeypointIndexShape>,
}

/// The size of a keypoint index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeypointIndexShape {
    /// Number of lists.
    pub lists: u32,
}

/// A part of the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Section {
    /// Name, unique.
    pub name: String,
    /// Start, bytes from the start of the file.
    pub offset: u64,
    /// Length, bytes.
    pub len: u64,
    /// blake3 of the bytes, hex; with `block_len`, of the hashes of its blocks, one after the other, which section
    /// `NAME.blocks` holds.
    pub blake3: String,
    /// Length of the blocks that are hashed, bytes; `None` if the section is hashed as a whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub block_len: Option<u64>,
}

impl Manifest {
    /// The section called `name`.
    pub(crate) fn section(&self, name: &str) -> Option<&Section> {
        self.sections.iter().find(|s| s.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_of_a_model_is_read_under_its_earlier_name_too() {
        let read = |precision: &str| -> ModelSummary {
            let text = format!(
                r#"{{"hash": "ab12", "preset": "compact", "card": {{}}, "descriptor_dim": 64, "global_dim": 256{precision}}}"#
            );
            serde_json::from_str(&text).unwrap()
        };
        assert_eq!(read("").precision, Precision::F32);
        for name in ["precision", "arithmetic"] {
            let model = read(&format!(r#", "{name}": "int8""#));
            assert_eq!(model.precision, Precision::Int8);
            assert_eq!(serde_json::to_value(model).unwrap()["precision"], "int8");
        }
    }
}
