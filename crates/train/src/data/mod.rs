//! Training pairs: a satellite-side and a drone-side view of one place, made on background threads from
//! single pictures or from procedural worlds.

mod corners;
mod homography;
mod layout;
mod mapping;
mod pair;
mod photometric;
mod pictures;
mod piece;
mod resample;
mod sources;
mod stream;
mod worlds;

pub use corners::corners;
pub use homography::{HomographyRange, apply, random_homography};
pub use layout::Layout;
pub use mapping::{Mapping, Seen};
pub use pair::{LABEL_NONE, Pair, PairOptions, Place, Source};
pub use photometric::{Look, change_look};
pub use pictures::{Aside, Fold, Folder, Picture, Pictures};
pub use piece::Piece;
pub use resample::warp;
pub use sources::Data;
pub use stream::{Batch, Sources, Stream, batch_of};
pub use worlds::{WorldOptions, Worlds};
