//! The arguments `model` and `precision`: which network computes features, and in which arithmetic.

use std::path::PathBuf;

use grimnet_net::{Arithmetic, Model};
use pyo3::prelude::*;

use crate::errors::{invalid_value, model_error};

/// Reads the model, the bundled one for `None`, to be computed in the arithmetic `precision`: `f32` or `int8`.
///
/// # Errors
/// `InvalidValueError` for another name of an arithmetic; `ModelError` for a model that cannot be read or not be computed in it.
pub fn open_model(path: Option<&PathBuf>, precision: &str) -> PyResult<Model> {
    let arithmetic: Arithmetic = precision.parse().map_err(|_| {
        let names = Arithmetic::ALL.map(|known| format!("{:?}", known.name()));
        invalid_value(format!(
            "precision is {precision:?}; expected {}",
            names.join(" or ")
        ))
    })?;
    match path {
        Some(path) => Model::open(path),
        None => Model::bundled(),
    }
    .and_then(|model| model.with_arithmetic(arithmetic))
    .map_err(|error| model_error(&error))
}
