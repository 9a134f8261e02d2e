//! Training pairs: a map view and a drone view of one place, made on background threads from single pictures, from matched
//! pictures, from procedural worlds, or from drawn figures.

mod adaptation;
mod cell_labels;
mod corners;
mod counterpart;
mod cross_view;
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
mod picture;
mod pictures;
mod rendered_place;
mod resample;
mod scene;
mod shapes;
mod stream;
mod worlds;

pub use adaptation::{Detect, View, adapt};
pub use cell_labels::LABEL_NONE;
pub use corners::corners;
pub use counterpart::Counterpart;
pub use cross_view::CrossView;
pub use homography::{HomographyRange, apply, random_homography};
pub use label_cache::LabelCache;
pub use label_options::LabelOptions;
pub use labels::Labels;
pub use layout::{Fold, Folder, Layout, Serves, Task};
pub use mapping::Mapping;
pub use pair::{Pair, PairOptions, Place, Source};
pub use photometric::{Look, change_look};
pub use picture::Picture;
pub use pictures::{HeldOut, Pictures};
pub use rendered_place::RenderedPlace;
pub use resample::warp;
pub use scene::Scene;
pub use shapes::Shapes;
pub(crate) use stream::usable;
pub use stream::{Batch, BatchOptions, Sources, Stream, WeightedSource, batch_of};
pub use worlds::{WorldOptions, Worlds};
