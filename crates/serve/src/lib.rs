//! The HTTP service: photos in, positions out, on the maps that it was started with.
//!
//! [`Service::bind`] listens on an address, [`Service::run`] answers requests until the service is stopped. Each [`ServedMap`] is a
//! pack with its localiser. [`Limits`] bound what clients may take, [`Access`] says who may ask. What the service answers is
//! described at `/openapi.json`.
//!
//! ```no_run
//! use grimnet_locate::Localizer;
//! use grimnet_serve::{Access, Limits, ServedMap, Service};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let map = ServedMap::new("area", Localizer::open("area.grim")?, None)?;
//! let address = "127.0.0.1:8080".parse()?;
//! let service = Service::bind(address, Access::ThisMachine, vec![map], Limits::default())?;
//! println!("http://{}", service.address());
//! service.run(true)?;
//! # Ok(())
//! # }
//! ```
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod access;
mod admission;
mod answer_detail;
mod answer_type;
mod answers_route;
mod assets;
mod background;
mod connections;
mod entity_tag;
mod error;
mod forwarded;
mod health_routes;
mod limits;
mod lingering_close;
mod locate_route;
mod map_routes;
mod maps;
mod metrics;
mod openapi;
mod path;
mod photo;
mod prior_fields;
mod problem;
mod protection;
mod query;
mod request_body;
mod request_log;
mod router;
mod service;
mod session_page;
mod stall_guard;
mod state;
mod tile_address;
mod tile_cache;
mod tile_mesh;
mod tile_picture;
mod tile_rendering;
mod tile_routes;
mod token;
mod track_events_route;
mod track_formats;
mod track_frame;
mod track_point_schema;
mod track_routes;
mod track_session_route;
mod track_store;
mod upload;
mod weighted_list;

pub use access::Access;
pub use error::ServeError;
pub use grimnet_photo::PhotoLimits;
pub use limits::Limits;
pub use maps::ServedMap;
pub use service::{Service, StopHandle};
pub use session_page::session_page;
pub use token::Token;
pub use track_frame::TrackFrame;
