//! A procedural town and countryside, rendered as a map and as drone photos, with exact ground truth.
//!
//! A [`World`] is built from a seed: roads, buildings with height and roofs, trees, fields, water,
//! cars. The same world is rendered as an orthophoto ([`World::render_map`]) and as a perspective
//! photo ([`World::render_photo`]) under two different [`Look`]s (season, sun, sensor, time), so
//! that the pair differs as a satellite map and a drone photo of one place do, while the mapping
//! between their pixels stays known exactly ([`View`], [`MapFrame`]).
//!
//! # Frames
//! - *world*: metres, `x_m` to grid east, `y_m` to grid north, origin at the south-west corner of
//!   the map, `z_m` height above the (flat) ground.
//! - *layout*: the plane in which the plan of roads and parcels is drawn with straight lines; a
//!   smooth warp bends it into the world. Internal.
//! - *photo px*, *map px*: continuous, (0, 0) is the outer corner of the top-left pixel.
//!
//! # Example
//! ```
//! use grimnet_world::{Camera, Look, Pose, RegionM, Season, World, WorldConfig};
//!
//! let world = World::new(WorldConfig { seed: 7, size_m: 300.0, ..WorldConfig::default() });
//! let map = world.render_map(
//!     RegionM { x_min_m: 100.0, y_min_m: 100.0, width_m: 20.0, height_m: 10.0 },
//!     0.5,
//!     &Look::satellite(Season::Summer),
//! );
//! assert_eq!(map.dimensions(), (40, 20));
//! let pose = Pose { x_m: 150.0, y_m: 150.0, height_agl_m: 110.0, ..Pose::default() };
//! let camera = Camera { hfov_deg: 70.0, width_px: 64, height_px: 48 };
//! let photo = world.render_photo(&pose, &camera, &Look::drone(Season::Summer));
//! assert_eq!(photo.dimensions(), (64, 48));
//! ```
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod bucket_grid;
mod camera;
mod colour;
mod config;
mod convex;
mod cover;
mod crossing;
mod error;
mod flight;
mod geotiff;
mod grass;
mod ground;
mod ground_noise;
mod layout;
mod look;
mod noise;
mod object_albedo;
mod objects;
mod placement;
mod populate;
mod random;
mod relief;
mod render;
mod road;
mod sensor;
mod shade;
mod solid;
mod solid_ray;
mod tagged_jpeg;
mod texture;
mod tree;
mod truth;
mod warp;
mod world;

pub use camera::{Camera, Pose, View};
pub use config::WorldConfig;
pub use crossing::Crossing;
pub use error::WorldError;
pub use flight::{Flight, Frame};
pub use geotiff::write_geotiff;
pub use look::{Look, Season, SensorModel};
pub use placement::Placement;
pub use render::{MapFrame, RegionM};
pub use tagged_jpeg::{PhotoTags, write_jpeg_with_exif};
pub use truth::{TruthRow, write_truth_csv};
pub use world::{Land, World};
