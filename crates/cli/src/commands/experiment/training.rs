//! The experiments that train networks: only in builds with the trainer.

#[cfg(not(feature = "train"))]
mod absent;
#[cfg(feature = "train")]
mod session;

#[cfg(not(feature = "train"))]
pub use absent::Training;
#[cfg(feature = "train")]
pub use session::Training;
