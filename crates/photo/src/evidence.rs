//! What was believed and what was set aside, in plain words.

use serde::Serialize;

/// One piece of metadata (or of the user's word), and why it was used or set aside.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evidence {
    /// The field as its source names it, such as `drone-dji:GimbalYawDegree` or `--heading`.
    pub field: String,
    /// Its value as read, with the unit.
    pub value: String,
    /// Why, in plain words.
    pub reason: String,
}

impl Evidence {
    /// Puts the three together.
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
