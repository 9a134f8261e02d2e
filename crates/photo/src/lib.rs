//! Drone photos: decoding, EXIF and XMP metadata, camera model, resampling to a query.
//!
//! [`Photo::open`] reads a photo at the size that localisation needs, [`Photo::open_full`] at full size. [`Photo::view`] decides which
//! metadata are used for heading, tilt and ground width, and states the reasons. [`Photo::query_maker`] resamples the photo to the
//! ground resolution and rotation of a map.
//!
//! ```no_run
//! use grimnet_photo::{Photo, QueryOptions, ViewPrior};
//! let photo = Photo::open("DJI_0042.jpg")?;
//! let view = photo.view(&ViewPrior::default());
//! for evidence in &view.set_aside {
//!     eprintln!("not used: {evidence}");
//! }
//! if let (Some(heading), Some(footprint)) = (view.heading, view.footprint) {
//!     let maker = photo.query_maker(&QueryOptions {
//!         tilt: view.tilt,
//!         ..QueryOptions::new(0.3, footprint.width_m)
//!     })?;
//!     let query = maker.make(heading.heading_deg); // for a map with north up
//!     assert_eq!(query.image.width() % 32, 0);
//! }
//! # Ok::<(), grimnet_photo::PhotoError>(())
//! ```
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod area;
mod budget;
pub mod calendar;
mod camera;
mod container;
mod decode;
mod error;
mod evidence;
mod exif_fields;
mod exposure_time;
mod heading;
mod metadata;
mod nadir_angles;
mod padded_image;
mod photo;
mod photo_file;
pub mod pictures;
mod points;
mod query;
mod read_metadata;
mod resolve;
mod scale;
mod tiff_directory;
mod view;
mod warp;
mod xmp_fields;

pub use budget::MIN_SIDE_PX;
pub use camera::{
    EquivalentFocal, FULL_FRAME_DIAGONAL_MM, MAX_DEPTH_RATIO, MAX_PITCH_FROM_NADIR_DEG,
    NativeFrame, Tilt, focal_px, focal_px_from_35mm, fov_deg,
};
pub use error::PhotoError;
pub use evidence::Evidence;
pub use exposure_time::ExposureTime;
pub use grimnet_jpeg::Damage;
pub use grimnet_limits::PhotoLimits;
pub use metadata::{GpsPosition, ImageDirection, Metadata};
pub use photo::{Photo, QUERY_LONG_SIDE_PX};
pub use photo_file::read_photo_file;
pub use points::{PhotoPx, QueryPx};
pub use query::{DEFAULT_MAX_SIDE_PX, Query, QueryMaker, QueryOptions, SIDE_MULTIPLE_PX};
pub use scale::{HEIGHT_AGL_RANGE_M, HFOV_RANGE_DEG, PHOTO_GSD_RANGE_M};
pub use view::{
    CameraAttitude, Footprint, HEADING_RANGE_DEG, Heading, HeadingPrior, PITCH_RANGE_DEG,
    ROLL_RANGE_DEG, View, ViewPrior,
};
pub use warp::LEVEL_PX_PER_QUERY_PX;
