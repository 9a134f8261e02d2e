//! Reads scenes of AnyVisLoc (Ye et al. 2026, CVPR Findings, arXiv 2503.10692) in their published layout.
//!
//! Written from the readme of github.com/UAV-AVL/Benchmark and from its reader (`avl_data.py`, `avl_utils.py`), and tested on folders
//! of that layout only: the data set itself may not be redistributed.
//!
//! `Scene_01/` holds `L01_reference.json`, the maps that it names (`aerial_map.png`, `satellite_map.png`), their surface models, which
//! are not used here, and one `L01_0001.npz` per photo: the picture (`image`), the camera matrix (`K`), the camera's position (`xyz`)
//! and attitude (`euler_deg`: roll, pitch off straight down, yaw). Positions are metres in a local plane of the scene, x to the east, y
//! to the south, z above the mean ground; the publishers withhold the true coordinates. The plane is placed at longitude and latitude
//! zero here: distances in metres agree to a millimetre in a kilometre; longitudes and latitudes have no meaning.
//!
//! Two truths: the receiver's is the camera's position, which the publishers' own figures refer to; the image centre's is where the
//! line of sight meets the mean ground, as in their `view_center_anyvisloc`. Lens distortion is not removed from the pictures.
//!
//! The photos are `.npz` archives: without the feature `anyvisloc` scenes are recognised and refused.

mod files;
#[cfg(feature = "anyvisloc")]
mod plane;
#[cfg(feature = "anyvisloc")]
mod reader;
#[cfg(feature = "anyvisloc")]
mod sample;
mod scene;

pub use files::is_scene;
#[cfg(feature = "anyvisloc")]
pub use reader::read;
pub use scene::{AnyVisLocError, AnyVisLocScene};

/// Refuses the scene: this build has no reader of its photos.
///
/// # Errors
/// Always.
#[cfg(not(feature = "anyvisloc"))]
pub fn read(
    folder: &std::path::Path,
    _map: Option<&std::path::Path>,
    _photos: &std::path::Path,
) -> Result<AnyVisLocScene, AnyVisLocError> {
    Err(AnyVisLocError::NotBuilt {
        folder: folder.to_owned(),
    })
}
