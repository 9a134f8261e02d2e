//! The model that comes with the program.

use crate::{Model, NetError};

#[cfg(grimnet_bundled_model)]
static BUNDLED: Option<&[u8]> = Some(include_bytes!("../models/compact.safetensors"));
#[cfg(not(grimnet_bundled_model))]
static BUNDLED: Option<&[u8]> = None;

/// Seed of the stand-in where no trained model is in the source tree.
const STAND_IN_SEED: u64 = 0;

impl Model {
    /// The model that was compiled in (`crates/net/models/compact.safetensors`). A source tree without that file gives a
    /// random `compact` network, warns in the log, and says so in its card ([`Model::is_random`]).
    ///
    /// # Errors
    /// [`NetError::ModelFile`] where the compiled-in file is damaged.
    pub fn bundled() -> Result<Self, NetError> {
        match BUNDLED {
            Some(bytes) => {
                let wrong = |reason| NetError::ModelFile {
                    path: "(bundled) crates/net/models/compact.safetensors".into(),
                    reason,
                };
                Self::from_bytes(bytes).map_err(wrong)
            }
            None => {
                tracing::warn!(
                    "no trained model was compiled in: the network has RANDOM numbers and cannot localise; \
                     put one at crates/net/models/compact.safetensors and build again, or name a model file"
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
    fn there_is_always_a_bundled_model_and_it_is_honest() {
        let model = Model::bundled().unwrap();
        assert_eq!(model.is_random(), BUNDLED.is_none());
    }
}
