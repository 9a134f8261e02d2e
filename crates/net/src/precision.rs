//! The precision in which a network is computed.

use std::fmt;
use std::str::FromStr;

use grimnet_kernels::Isa;
use serde::{Deserialize, Serialize};

use crate::{Decoder, Downsample, KeypointHead, NetSpec, VladInput};

/// The precision of a network's convolutions ([`crate::Model::with_precision`]). What is stored without one was computed in single
/// precision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// Activations and weights of encoder, decoder and the layers on top are rounded to bytes; keypoints are those of
    /// [`Precision::F32`]. For networks of the form of [`NetSpec::compact`].
    Int8,
    /// [`Precision::Int8`] for [`Purpose::Search`] and [`Precision::F32`] for [`Purpose::Answer`].
    Mixed,
}

/// What a pass of a network is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// To find what is looked at again: one of many views, most of which are turned or scaled wrongly.
    Search,
    /// To be stored, or to give an answer.
    Answer,
}

impl Precision {
    /// All.
    pub const ALL: [Precision; 3] = [Precision::Mixed, Precision::F32, Precision::Int8];

    /// The one that a model of this description has unless another is chosen: mixed, or single precision where the network cannot be
    /// computed in bytes or it would take longer ([`Isa::has_byte_products`]).
    pub fn usual(spec: &NetSpec, isa: Isa) -> Self {
        if Precision::Mixed.supports(spec) && isa.has_byte_products() {
            Precision::Mixed
        } else {
            Precision::F32
        }
    }

    /// The precision of passes for this purpose, which is not mixed.
    #[must_use]
    pub fn of(self, purpose: Purpose) -> Self {
        match (self, purpose) {
            (Precision::Mixed, Purpose::Search) => Precision::Int8,
            (Precision::Mixed, Purpose::Answer) => Precision::F32,
            (pure, _) => pure,
        }
    }

    /// The name: `mixed`, `f32` or `int8`.
    pub fn name(self) -> &'static str {
        match self {
            Precision::F32 => "f32",
            Precision::Int8 => "int8",
            Precision::Mixed => "mixed",
        }
    }

    /// Whether it is single precision for every purpose.
    pub fn is_f32(&self) -> bool {
        *self == Precision::F32
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

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// No precision has this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown precision '{0}'; expected mixed, f32 or int8")]
pub struct UnknownPrecision(pub String);

impl FromStr for Precision {
    type Err = UnknownPrecision;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|precision| precision.name() == name)
            .ok_or_else(|| UnknownPrecision(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for precision in Precision::ALL {
            assert_eq!(precision.name().parse(), Ok(precision));
        }
        assert_eq!(
            "i8".parse::<Precision>(),
            Err(UnknownPrecision("i8".into()))
        );
    }

    #[test]
    fn only_networks_of_the_form_of_compact_are_computed_in_int8() {
        for spec in NetSpec::presets() {
            let is_compact = spec.preset == "compact";
            assert!(Precision::F32.supports(&spec));
            assert_eq!(Precision::Int8.supports(&spec), is_compact);
            for isa in Isa::available() {
                let is_mixed = Precision::usual(&spec, isa) == Precision::Mixed;
                assert_eq!(is_mixed, is_compact && isa.has_byte_products());
            }
            assert_eq!(Precision::usual(&spec, Isa::Portable), Precision::F32);
        }
    }
}
