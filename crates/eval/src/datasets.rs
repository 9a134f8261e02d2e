//! Data sets: what a folder must hold so that photos with a known position can be localised and scored.
//!
//! [`DataSet::find`] recognises the layout of a folder and reads it; the layouts are in [`truth`] (the program's own), [`visloc`],
//! [`anyvisloc`] and [`msdi`].

pub mod anyvisloc;
mod layout;
pub mod msdi;
#[cfg(feature = "anyvisloc")]
pub mod npz;
pub mod truth;
pub mod visloc;

pub use layout::{DataSet, DataSetError, DataSetRequest};
