//! The model that is compiled into the program.

use std::path::Path;

use crate::{Model, NetError};

#[cfg(grimnet_bundled_model)]
static BUNDLED: Option<&[u8]> = Some(include_bytes!("../models/compact.safetensors"));
#[cfg(not(grimnet_bundled_model))]
static BUNDLED: Option<&[u8]> = None;

/// How errors name the bundled model.
const BUNDLED_NAME: &str = "(bundled model) crates/net/models/compact.safetensors";

/// Seed of the random network that is used if no trained model is in the source tree.
const STAND_IN_SEED: u64 = 0;

impl Model {
    /// The model that was compiled in (`crates/net/models/compact.safetensors`). If that file was missing at build time,
    /// this is a random `compact` network ([`Model::is_random`]), and a warning is logged.
    ///
    /// # Errors
    /// [`NetError::ModelFile`] if the compiled-in file is damaged.
    pub fn bundled() -> Result<Self, NetError> {
        match BUNDLED {
            Some(bytes) => Self::from_bytes(bytes, Path::new(BUNDLED_NAME)),
            None => {
                tracing::warn!(
                    "no trained model was compiled in: the network has RANDOM weights and cannot localise; \
                     put a model at crates/net/models/compact.safetensors and build again, or open a model file"
                );
                Self::random(&crate::NetSpec::compact(), STAND_IN_SEED)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_always_a_bundled_model_and_a_random_one_says_so() {
        let model = Model::bundled().unwrap();
        assert_eq!(model.is_random(), BUNDLED.is_none());
    }

    #[cfg(grimnet_bundled_model)]
    #[test]
    fn the_bundled_model_has_a_checksum_and_a_calibration() {
        let bytes = BUNDLED.unwrap();
        let path = Path::new(BUNDLED_NAME);
        let model = Model::from_bytes(bytes, path).unwrap();
        assert!(model.calibration().fitted_on.is_some());
        let mut damaged = bytes.to_vec();
        damaged[bytes.len() / 2] ^= 1;
        let error = Model::from_bytes(&damaged, path).unwrap_err().to_string();
        assert!(error.contains("checksum"), "{error}");
    }
}
