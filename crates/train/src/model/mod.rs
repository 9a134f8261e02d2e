//! The network on burn tensors.

pub(crate) mod device;
pub(crate) mod grow;
mod grow_plan;
pub(crate) mod identity_norm;
pub(crate) mod input;
pub(crate) mod netvlad_init;
pub(crate) mod network;
pub(crate) mod normalisation;
pub(crate) mod parameters;
mod resample;
pub(crate) mod teacher;
pub(crate) mod vlad;
