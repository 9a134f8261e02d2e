//! Training pairs: a satellite-side and a drone-side view of one place, made on background threads from
//! single pictures, from procedural worlds, or from drawn figures.

mod adaptation;
mod cell_labels;
mod corners;
mod cuts;
mod homography;
mod label_cache;
mod label_options;
mod labels;
mod layout;
mod mapping;
mod pair;
mod peaks;
mod photometric;
mod pictures;
mod piece;
mod resample;
mod scene;
mod shapes;
mod sources;
mod stream;
mod worlds;

pub use adaptation::{Detect, View, adapt};
pub use cell_labels::LABEL_NONE;
pub use corners::corners;
pub use homography::{HomographyRange, apply, random_homography};
pub use label_cache::LabelCache;
pub use label_options::LabelOptions;
pub use labels::Labels;
pub use layout::Layout;
pub use mapping::{Mapping, Seen};
pub use pair::{Pair, PairOptions, Place, Source};
pub use photometric::{Look, change_look};
pub use pictures::{Aside, Fold, Folder, Picture, Pictures};
pub use piece::Piece;
pub use resample::warp;
pub use scene::Scene;
pub use shapes::Shapes;
pub use sources::Data;
pub use stream::{Batch, Sources, Stream, batch_of};
pub use worlds::{WorldOptions, Worlds};
