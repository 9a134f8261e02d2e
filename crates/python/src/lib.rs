//! The extension module of the Python package `grimnet`: what `python/grimnet/__init__.py` exports.
//!
//! Python's names, units and field names are those of the program: an answer has the fields of the JSON line that `grim locate`
//! prints. Long work releases the interpreter lock.
//!
//! The crate is empty without its feature `extension`, which maturin turns on.
#![cfg(feature = "extension")]

mod answers;
mod errors;
mod features;
mod library_log;
mod localizer;
mod long_work;
mod matching;
mod model_file;
mod pack_build;
mod photo_input;
mod prior_arguments;
mod rgb_copy;
mod track_point;
mod tracker;

use pyo3::prelude::*;

#[pymodule]
fn _grimnet(module: &Bound<'_, PyModule>) -> PyResult<()> {
    library_log::start();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    errors::add_to(module)?;
    module.add_class::<answers::Fix>()?;
    module.add_class::<answers::NoFix>()?;
    module.add_class::<localizer::Localizer>()?;
    module.add_class::<tracker::Tracker>()?;
    module.add_class::<track_point::TrackPoint>()?;
    module.add_class::<features::FeatureExtractor>()?;
    module.add_class::<features::Features>()?;
    module.add_class::<matching::Matches>()?;
    module.add_class::<pack_build::BuildProgress>()?;
    module.add_class::<pack_build::BuildReport>()?;
    module.add_function(wrap_pyfunction!(matching::match_features, module)?)?;
    module.add_function(wrap_pyfunction!(pack_build::build_pack, module)?)?;
    module.add_function(wrap_pyfunction!(photo_input::read_photo, module)?)
}
