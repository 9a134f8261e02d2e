//! From a photo and a map pack to a fix: matching, homography, gates, the [`Localizer`].
//!
//! ```no_run
//! use grimnet_locate::{Localizer, Outcome, Prior};
//! use grimnet_net::Model;
//! use grimnet_pack::Pack;
//! use grimnet_photo::Photo;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let localizer = Localizer::new(Model::bundled()?, Pack::open("area.grim")?)?;
//! let photo = Photo::open("DJI_0042.jpg")?;
//! match localizer.locate(&photo, &Prior::none())? {
//!     Outcome::Fix(fix) => println!("{:.7} {:.7} ±{:.1} m", fix.lat_deg, fix.lon_deg, fix.radius95_m),
//!     Outcome::NoFix(reason) => eprintln!("{reason}"),
//! }
//! # Ok(())
//! # }
//! ```
//!
//! A photo is resampled as the map would show it under each hypothesis of heading and scale; tiles are found by global
//! descriptor, ranked by a vote over translations, matched in full in that order until one passes the gates clearly. The
//! geometry modules know pixels of two pictures only; metres and degrees come in with the facade.

// `!(x > limit)` is meant: a NaN must fail the check.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod answer;
mod attempt;
mod candidates;
mod cascade;
mod confidence;
pub mod correspondence;
pub mod covariance;
pub mod draw;
mod error;
pub mod gates;
mod guided;
pub mod homography;
pub mod hypotheses;
mod localizer;
pub mod matching;
mod options;
mod outcome;
mod paper;
mod place;
mod prior;
mod query_features;
mod ranking;
pub mod ransac;
pub mod refine;
pub mod sampler;
pub mod similarity;
pub mod solve;
mod trace;
pub mod transform;
mod verify;
pub mod vote;

pub use confidence::Support;
pub use error::{LocateError, Result};
pub use gates::{Gates, Rejection};
pub use localizer::Localizer;
pub use options::{
    Adapt, Choice, Coordinates, DEFAULT_MAP_ERROR_M, GeometryModel, Mode, Options, Search,
};
pub use outcome::{
    EvidenceUsed, Fix, MatchedPoints, NoFix, Outcome, Reason, RunnerUp, TileRef, TimeMs,
};
pub use prior::{HeadingPrior, Near, Prior};
pub use trace::{RoundTrace, Trace};
