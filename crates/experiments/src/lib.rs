//! The paper's experiments, robustness sweeps, the SIFT baseline, and the page of stored evaluation figures.
//!
//! A [`grimnet_eval::scene::Scene`] is a map with photos; a [`bench::Setup`] is a way to localise them; the [`bench::Bench`] runs setups over
//! scenes and caches the results; [`tables`] and [`sweep`] define which setups make which table, [`training`] and [`networks`] those
//! that compare trained networks. The program `grim-experiments` runs them. [`claims`] makes EVALUATION.md from stored figures.

pub mod bench;
mod changed;
pub mod claim;
mod claim_section;
pub mod claims;
pub mod experiment;
pub mod experiment_table;
pub mod gallery;
pub mod gallery_recall;
pub mod given;
pub mod networks;
pub mod page;
pub mod paper_sift;
pub mod photometry;
pub mod recipe;
mod scene_rows;
pub mod sift;
pub mod sift_map;
pub mod sift_method;
pub mod stored;
pub mod sweep;
pub mod tables;
pub mod track_claims;
pub mod training;
pub mod world_flight;
