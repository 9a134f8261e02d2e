//! Exceptions: one family under `GrimnetError`, and which of them each error of the library becomes.

use grimnet::map::{BuildError, GeoError};
use grimnet_locate::LocateError;
use grimnet_net::NetError;
use grimnet_pack::PackError as LibraryPackError;
use grimnet_photo::PhotoError as LibraryPhotoError;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyType};

create_exception!(
    grimnet,
    GrimnetError,
    PyException,
    "Base of all errors of this package. A photo whose position is not found is no error but `NoFix`."
);
create_exception!(
    grimnet,
    PhotoError,
    GrimnetError,
    "A photo cannot be read or used."
);
create_exception!(
    grimnet,
    PackError,
    GrimnetError,
    "A map pack cannot be opened, built or used."
);
create_exception!(
    grimnet,
    MapError,
    GrimnetError,
    "A map cannot be read or has no usable georeference."
);
create_exception!(
    grimnet,
    ModelError,
    GrimnetError,
    "A model cannot be read or used."
);

/// `InvalidValueError`, which is a `GrimnetError` and a `ValueError`.
static INVALID_VALUE: PyOnceLock<Py<PyType>> = PyOnceLock::new();

fn invalid_value_type(py: Python<'_>) -> PyResult<&Bound<'_, PyType>> {
    let made = INVALID_VALUE.get_or_try_init(py, || {
        let bases = (py.get_type::<GrimnetError>(), py.get_type::<PyValueError>());
        let names = PyDict::new(py);
        names.set_item("__module__", "grimnet")?;
        names.set_item("__doc__", "An argument has a value that cannot be used.")?;
        let made = py
            .get_type::<PyType>()
            .call1(("InvalidValueError", bases, names))?;
        Ok::<_, PyErr>(made.cast_into::<PyType>()?.unbind())
    })?;
    Ok(made.bind(py))
}

/// Adds the exceptions to the module.
///
/// # Errors
/// The interpreter is out of memory.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("GrimnetError", py.get_type::<GrimnetError>())?;
    module.add("PhotoError", py.get_type::<PhotoError>())?;
    module.add("PackError", py.get_type::<PackError>())?;
    module.add("MapError", py.get_type::<MapError>())?;
    module.add("ModelError", py.get_type::<ModelError>())?;
    module.add("InvalidValueError", invalid_value_type(py)?)
}

/// An `InvalidValueError`.
pub fn invalid_value(message: impl std::fmt::Display) -> PyErr {
    Python::attach(|py| match invalid_value_type(py) {
        Ok(kind) => PyErr::from_type(kind.clone(), message.to_string()),
        Err(error) => error,
    })
}

/// A whole number that is given for `name`, as the type that the library takes, whose largest is `most`. Python would raise
/// `OverflowError` for what does not fit, which is no error of this package.
///
/// # Errors
/// `InvalidValueError` for a number that does not fit.
pub fn whole_number<T>(name: &str, given: i64, most: T) -> PyResult<T>
where
    T: TryFrom<i64> + std::fmt::Display,
{
    T::try_from(given).map_err(|_| {
        invalid_value(format!(
            "{name} is {given}; expected a whole number from 0 to {most}"
        ))
    })
}

/// A photo that cannot be read.
pub fn photo_error(error: &LibraryPhotoError) -> PyErr {
    PhotoError::new_err(error.to_string())
}

/// A model that cannot be read.
pub fn model_error(error: &NetError) -> PyErr {
    ModelError::new_err(error.to_string())
}

/// A pack that cannot be used.
pub fn pack_error(error: &LibraryPackError) -> PyErr {
    match error {
        LibraryPackError::Map(error) => map_error(error),
        LibraryPackError::Net(error) => model_error(error),
        LibraryPackError::Options(message) => invalid_value(message),
        error => PackError::new_err(error.to_string()),
    }
}

/// A photo that cannot be localised at all.
pub fn locate_error(error: &LocateError) -> PyErr {
    match error {
        LocateError::Net(error) => model_error(error),
        LocateError::Pack(error) => pack_error(error),
        LocateError::Photo(error) => photo_error(error),
        LocateError::Geo(error) => map_error(error),
        LocateError::InvalidValue { .. } => invalid_value(error),
        error => GrimnetError::new_err(error.to_string()),
    }
}

/// A pack that cannot be built.
pub fn build_error(error: &BuildError) -> PyErr {
    match error {
        BuildError::Map(error) => map_error(error),
        BuildError::Pack(error) => pack_error(error),
        BuildError::Model(error) => model_error(error),
        BuildError::Output(error) => output_error(error),
        error => GrimnetError::new_err(error.to_string()),
    }
}

/// An output that must not or cannot be written.
pub fn output_error(error: &grimnet_output::OutputError) -> PyErr {
    PackError::new_err(error.to_string())
}

fn map_error(error: &GeoError) -> PyErr {
    MapError::new_err(error.to_string())
}
