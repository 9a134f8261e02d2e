//! The paper's experiments and robustness sweeps, on any scenes.
//!
//! A [`scene::Scene`] is a map with photos; a [`bench::Setup`] is a way to answer them; the [`bench::Bench`] runs setups over scenes
//! and keeps what it has measured; [`tables`] and [`sweep`] say which setups make which table, `training` and
//! `networks` (with the `train` feature) those that compare networks.

pub mod bench;
pub mod flight;
#[cfg(feature = "train")]
pub mod networks;
pub mod page;
pub mod photometry;
pub mod scene;
mod scene_rows;
pub mod sweep;
pub mod tables;
#[cfg(feature = "train")]
pub mod training;
