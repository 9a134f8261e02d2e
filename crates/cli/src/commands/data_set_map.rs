//! The map of a data set, whose files are inputs of the run.

use anyhow::Result;
use grimnet_eval::datasets::DataSet;
use grimnet_geo::Raster;
use grimnet_output::OutputPolicy;

/// Opens the map of a data set. Under `policy` no output replaces a file of the data set or of the map.
///
/// # Errors
/// The map cannot be read or has no georeference.
pub fn open_map(data: &DataSet, policy: &OutputPolicy) -> Result<Box<dyn Raster>> {
    policy.add_inputs(data.files());
    let map = data.open_map()?;
    policy.add_input_trees(map.files());
    Ok(map)
}
