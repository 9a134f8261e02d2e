//! The arguments `model` and `precision`: which network computes features, and how precisely.

use std::path::PathBuf;

use grimnet_net::{Model, Precision};
use pyo3::prelude::*;

use crate::errors::{invalid_value, model_error};

/// Reads the model, the bundled one for `None`, to be computed in `precision`: `mixed`, `f32` or `int8`, the model's usual one
/// for `None`.
///
/// # Errors
/// `InvalidValueError` for another `precision`; `ModelError` for a model that cannot be read or not be computed in it.
pub fn open_model(path: Option<&PathBuf>, precision: Option<&str>) -> PyResult<Model> {
    let precision = precision.map(precision_of).transpose()?;
    let model = match path {
        Some(path) => Model::open(path),
        None => Model::bundled(),
    };
    model
        .and_then(|model| model.with_precision_if_given(precision))
        .map_err(|error| model_error(&error))
}

fn precision_of(name: &str) -> PyResult<Precision> {
    name.parse().map_err(|_| {
        let names = Precision::ALL.map(|known| format!("{:?}", known.name()));
        invalid_value(format!(
            "precision is {name:?}; expected {}",
            names.join(" or ")
        ))
    })
}
