//! The `model` argument: the path of a model file, or the bundled model.

use std::path::PathBuf;

use grimnet_net::Model;
use pyo3::prelude::*;

use crate::errors::model_error;

/// Reads the model, the bundled one for `None`.
///
/// # Errors
/// `ModelError`.
pub fn open_model(path: Option<&PathBuf>) -> PyResult<Model> {
    match path {
        Some(path) => Model::open(path),
        None => Model::bundled(),
    }
    .map_err(|error| model_error(&error))
}
