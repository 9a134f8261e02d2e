//! The two ways to build a pack.

use std::fmt;

use serde::{Deserialize, Serialize};

/// How a pack is built: as suits users best, or by the paper's procedure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Features are computed once per ground cell; tile descriptors are summed from cells.
    #[default]
    Default,
    /// Independent tiles of 512 px at stride 256, each resized for the network.
    Paper,
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Default => "default",
            Self::Paper => "paper",
        })
    }
}
