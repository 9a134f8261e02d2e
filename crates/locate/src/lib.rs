//! From a photo and a map pack to a fix: search, matching, verification, and the [`Localizer`] that runs them.
//!
//! ```no_run
//! use grimnet_locate::{Localizer, Outcome, Prior};
//! use grimnet_photo::Photo;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let localizer = Localizer::open("area.grim")?;
//! let photo = Photo::open("DJI_0042.jpg")?;
//! match localizer.locate(&photo, &Prior::none())? {
//!     Outcome::Fix(fix) => println!("{:.7} {:.7} ±{:.1} m", fix.lat_deg, fix.lon_deg, fix.radius95_m),
//!     Outcome::NoFix(reason) => eprintln!("{reason}"),
//! }
//! # Ok(())
//! # }
//! ```
//!
//! A photo is resampled as the map would show it under each hypothesis of heading and scale. Tiles are found by global
//! descriptor, ranked by a vote over translations, and matched in full in that order until one passes the gates clearly.
//!
//! - `geometry`: transforms between two pictures, in pixels;
//! - `search`: hypotheses, candidates, the vote;
//! - `pipeline`: the stages from a photo to an answer in default mode;
//! - `paper`: the paper's procedure and equations.

// `!(x > limit)` is intended: a NaN must fail the check.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod confidence;
mod context;
mod dense_query;
pub mod draw;
mod error;
mod frame_features;
mod frame_motion;
mod geometry;
mod localizer;
mod needed_pixels;
mod options;
mod outcome;
mod paper;
mod pipeline;
mod prior;
mod query_features;
mod search;
mod trace;
mod validation;

pub use confidence::Support;
pub use error::{LocateError, Result};
pub use frame_features::FrameFeatures;
pub use frame_motion::{FrameMotion, FramePair, FrameTilt};
pub use geometry::{
    estimation::GeometryModel,
    ransac::{Ransac, Score},
    sampler::Sampling,
};
pub use grimnet_pack::{Index, Mode};
pub use grimnet_photo::{HeadingPrior, ViewPrior};
pub use localizer::{Localizer, LocalizerBuilder};
pub use needed_pixels::NeededPixels;
pub use options::{
    Adapt, Choice, Coordinates, DEFAULT_MAP_ERROR_M, Gates, MapVoteOptions, Options, Recount,
    VoteOptions,
};
pub use outcome::{
    EvidenceUsed, Fix, MatchedPair, MatchedPoints, NoFix, Outcome, Reason, Rejection, RunnerUp,
    TileRef, TimeMs,
};
pub use prior::{Near, Prior};
pub use search::matching::MatchingError;
#[doc(hidden)]
pub use trace::{RoundTrace, Trace};

/// Parts that the tests of this crate and the evaluation use. They may change in any release.
#[doc(hidden)]
pub mod internals {
    pub use crate::{
        geometry::{
            correspondence, covariance, estimation, homography, plain_homography, ransac, refine,
            sampler, scale_prior, similarity, transform,
        },
        paper::procedure::NetworkImage,
        search::matching,
    };
}
