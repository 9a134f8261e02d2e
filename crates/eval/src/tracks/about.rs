//! The conditions of an evaluation of tracks.

use grimnet_net::Precision;
use serde::Serialize;

/// Conditions of the measurement.
#[derive(Debug, Clone, Serialize)]
pub struct TrackAbout {
    /// What was flown.
    pub data: String,
    /// Identity of the model.
    pub model_hash: String,
    /// Precision of the network.
    #[serde(skip_serializing_if = "Precision::is_f32")]
    pub precision: Precision,
    /// Commit that the program was built from, if given.
    pub commit: Option<String>,
    /// Version of the program.
    pub version: &'static str,
    /// Threads that searched.
    pub threads: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_is_stated_as_in_the_summary_of_photos() {
        let json = |precision| {
            let about = TrackAbout {
                data: "procedural world 7".to_owned(),
                model_hash: "ab12".to_owned(),
                precision,
                commit: None,
                version: "0.1.0",
                threads: 2,
            };
            serde_json::to_value(about).unwrap()
        };
        assert_eq!(json(Precision::Int8)["precision"], "int8");
        // Single precision is not stated, so that stored figures stay as they are.
        assert_eq!(json(Precision::F32).get("precision"), None);
    }
}
