//! The paper's experiments and robustness sweeps, on any scenes.
//!
//! A [`scene::Scene`] is a map with photos; a [`bench::Setup`] is a way to answer them; the [`bench::Bench`] runs setups over scenes
//! and keeps what it has measured; [`tables`] and [`sweep`] say which setups make which table.

pub mod bench;
pub mod flight;
pub mod page;
pub mod photometry;
pub mod scene;
pub mod sweep;
pub mod tables;
