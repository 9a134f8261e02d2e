//! Truth files, metrics and reports: how far off, how often, how honest.
//!
//! The way of the data: [`truth::read`] gives what each photo's answer should be,
//! [`metrics::Frame::score`] compares one answer with it, and [`metrics::Summary::of`] condenses all
//! frames into the figures that the field uses; [`report::Report`] shows them on one page.

pub mod anyvisloc;
pub mod calibration;
pub mod html;
pub mod map_picture;
pub mod metrics;
pub mod msdi;
mod npy;
mod npz;
pub mod plot;
pub mod rank_distance;
pub mod recall;
pub mod report;
pub mod risk_coverage;
pub mod sample;
pub mod truth;
pub mod visloc;
