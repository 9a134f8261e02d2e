//! The arithmetic in which a network is computed.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::{Decoder, Downsample, KeypointHead, NetSpec, VladInput};

/// The arithmetic of a network's convolutions ([`crate::Model::with_arithmetic`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Arithmetic {
    /// Single precision.
    #[default]
    F32,
    /// Activations and weights of encoder, decoder and the layers on top are rounded to bytes; keypoints are those of
    /// [`Arithmetic::F32`]. For networks of the form of [`NetSpec::compact`].
    Int8,
}

impl Arithmetic {
    /// All, the default first.
    pub const ALL: [Arithmetic; 2] = [Arithmetic::F32, Arithmetic::Int8];

    /// The name: `f32` or `int8`.
    pub fn name(self) -> &'static str {
        match self {
            Arithmetic::F32 => "f32",
            Arithmetic::Int8 => "int8",
        }
    }

    /// Whether it is the default.
    pub fn is_f32(&self) -> bool {
        *self == Arithmetic::F32
    }

    /// Whether networks of this description can be computed in it.
    pub fn supports(self, spec: &NetSpec) -> bool {
        // A layer's floats need more than four channels.
        const FEWEST: usize = 5;
        self.is_f32()
            || (spec
                .stages
                .iter()
                .all(|stage| stage.downsample == Downsample::StrideFirst)
                && matches!(spec.decoder, Decoder::Lateral { width } if width >= FEWEST)
                && spec.descriptor_dim >= FEWEST
                && spec.vlad.clusters >= FEWEST
                && matches!(spec.keypoints, KeypointHead::FromGrey { .. })
                && spec.vlad.input == VladInput::Descriptors)
    }
}

impl fmt::Display for Arithmetic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The name is neither `f32` nor `int8`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown arithmetic '{0}', expected f32 or int8")]
pub struct UnknownArithmetic(pub String);

impl FromStr for Arithmetic {
    type Err = UnknownArithmetic;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|arithmetic| arithmetic.name() == name)
            .ok_or_else(|| UnknownArithmetic(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for arithmetic in Arithmetic::ALL {
            assert_eq!(arithmetic.name().parse(), Ok(arithmetic));
        }
        assert_eq!(
            "i8".parse::<Arithmetic>(),
            Err(UnknownArithmetic("i8".into()))
        );
    }

    #[test]
    fn only_networks_of_the_form_of_compact_are_computed_in_int8() {
        for spec in NetSpec::presets() {
            assert!(Arithmetic::F32.supports(&spec));
            assert_eq!(Arithmetic::Int8.supports(&spec), spec.preset == "compact");
        }
    }
}
