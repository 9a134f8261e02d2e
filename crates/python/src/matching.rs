//! `match`: mutual nearest neighbours of two sets of descriptors.

use grimnet_kernels::Isa;
use grimnet_locate::internals::matching::{Descriptors, Match, Matcher};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::invalid_value;
use crate::features::Features;
use crate::long_work::detached;
use crate::photo_input::row_by_row;

/// Pairs of rows that match, in the order of the first.
#[pyclass(frozen, module = "grimnet")]
pub struct Matches {
    /// m x 2: row of the first, row of the second.
    #[pyo3(get)]
    indices: Py<PyArray2<i64>>,
    /// m: cosine of the angle between the two descriptors.
    #[pyo3(get)]
    similarities: Py<PyArray1<f32>>,
}

#[pymethods]
impl Matches {
    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.similarities.bind(py).len())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("Matches({} pairs)", self.__len__(py)?))
    }
}

/// Mutual nearest neighbours of two `Features`, or of two arrays n x dimension of float32 with rows of unit length.
///
/// With `max_ratio` a pair is kept if its distance is below that many times the distance to the second nearest (Lowe 2004).
#[pyfunction]
#[pyo3(name = "match", signature = (first, second, *, max_ratio=None))]
pub fn match_features<'py>(
    first: &Bound<'py, PyAny>,
    second: &Bound<'py, PyAny>,
    max_ratio: Option<f32>,
) -> PyResult<Matches> {
    let py = first.py();
    if max_ratio.is_some_and(|ratio| !(ratio > 0.0 && ratio <= 1.0)) {
        return Err(invalid_value(
            "max_ratio: expected a number above 0, at most 1",
        ));
    }
    let (first, second) = (descriptors(first)?, descriptors(second)?);
    let dim = first.shape()[1];
    if dim != second.shape()[1] {
        return Err(invalid_value(format!(
            "descriptors of {dim} and of {} numbers; expected the same dimension",
            second.shape()[1]
        )));
    }
    let (a, b) = (
        row_by_row(&first.as_array()),
        row_by_row(&second.as_array()),
    );
    let found = detached(py, || {
        let mut found: Vec<Match> = Vec::new();
        Matcher::new(Isa::detect())
            .mutual(
                Descriptors::F32(&a),
                Descriptors::F32(&b),
                dim,
                max_ratio,
                &mut found,
            )
            .map_err(invalid_value)?;
        Ok(found)
    })?;
    py.check_signals()?;
    let pairs: Vec<i64> = found
        .iter()
        .flat_map(|pair| [i64::from(pair.query), i64::from(pair.tile)])
        .collect();
    let similarities: Vec<f32> = found.iter().map(|pair| pair.similarity).collect();
    Ok(Matches {
        indices: pairs.into_pyarray(py).reshape([found.len(), 2])?.unbind(),
        similarities: similarities.into_pyarray(py).unbind(),
    })
}

/// The descriptors of features, or an array.
fn descriptors<'py>(given: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray2<'py, f32>> {
    let array = match given.cast::<Features>() {
        Ok(features) => features.get().descriptors.bind(given.py()).clone(),
        Err(_) => given
            .cast::<PyArray2<f32>>()
            .cloned()
            .map_err(|_| invalid_value("expected Features or an array n x dimension of float32"))?,
    };
    // A field of records may begin at any byte, at which no view of it can.
    let array = if array.is_aligned() {
        array
    } else {
        array.call_method0("copy")?.cast_into()?
    };
    array.try_readonly().map_err(invalid_value)
}
