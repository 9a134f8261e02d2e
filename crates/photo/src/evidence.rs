//! Which metadata were used or not, and why.

use serde::{Deserialize, Serialize};

/// One metadata field or prior value, and why it was used or not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// The field as its source names it, such as `GimbalYawDegree`.
    pub field: String,
    /// Its value as read, with the unit.
    pub value: String,
    /// The reason.
    pub reason: String,
}

impl Evidence {
    /// Creates an entry.
    pub fn new(
        field: impl Into<String>,
        value: impl Into<String>,
        reason: impl Into<String>,
    ) -> Self {
        Self {
            field: field.into(),
            value: value.into(),
            reason: reason.into(),
        }
    }
}

impl std::fmt::Display for Evidence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} = {}: {}", self.field, self.value, self.reason)
    }
}
