//! Training pairs: a satellite-side and a drone-side view of one place, made from single pictures on background threads.

mod corners;
mod homography;
mod pair;
mod photometric;
mod pictures;
mod resample;
mod stream;

pub use corners::corners;
pub use homography::{HomographyRange, apply, random_homography};
pub(crate) use pair::group_of;
pub use pair::{LABEL_NONE, Pair, PairOptions, Place, Source};
pub use photometric::{Look, change_look};
pub use pictures::{Fold, Folder, Picture, Pictures};
pub use resample::warp;
pub use stream::{Batch, Sources, Stream, batch_of};
