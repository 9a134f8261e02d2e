//! The arguments `model` and `precision`: which network computes features, and in which arithmetic.

use std::path::PathBuf;

use grimnet_net::{Arithmetic, Model};
use pyo3::prelude::*;

use crate::errors::{invalid_value, model_error};

/// Reads the model, the bundled one for `None`, to be computed in the arithmetic `precision`: `mixed`, `f32` or `int8`, the model's
/// usual one for `None`.
///
/// # Errors
/// `InvalidValueError` for another name of an arithmetic; `ModelError` for a model that cannot be read or not be computed in it.
pub fn open_model(path: Option<&PathBuf>, precision: Option<&str>) -> PyResult<Model> {
    let arithmetic = precision.map(arithmetic_of).transpose()?;
    let model = match path {
        Some(path) => Model::open(path),
        None => Model::bundled(),
    };
    model
        .and_then(|model| match arithmetic {
            Some(arithmetic) => model.with_arithmetic(arithmetic),
            None => Ok(model),
        })
        .map_err(|error| model_error(&error))
}

fn arithmetic_of(name: &str) -> PyResult<Arithmetic> {
    name.parse().map_err(|_| {
        let names = Arithmetic::ALL.map(|known| format!("{:?}", known.name()));
        invalid_value(format!(
            "precision is {name:?}; expected {}",
            names.join(" or ")
        ))
    })
}
