//! Measuring networks, and exporting models.

mod card;
pub(crate) mod export;
mod homography_estimate;
mod pair_figures;
pub(crate) mod scene_accuracy;
pub(crate) mod statistics;
pub(crate) mod validation;
pub(crate) mod validator;
pub(crate) mod whitening;
