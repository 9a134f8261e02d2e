//! The conditions of an evaluation of tracks.

use grimnet_net::Arithmetic;
use serde::Serialize;

/// Conditions of the measurement.
#[derive(Debug, Clone, Serialize)]
pub struct TrackAbout {
    /// What was flown.
    pub data: String,
    /// Identity of the model.
    pub model_hash: String,
    /// Arithmetic of the network.
    #[serde(skip_serializing_if = "Arithmetic::is_f32")]
    pub arithmetic: Arithmetic,
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
    fn arithmetic_is_told_as_in_the_summary_of_photos() {
        let json = |arithmetic| {
            let about = TrackAbout {
                data: "procedural world 7".to_owned(),
                model_hash: "ab12".to_owned(),
                arithmetic,
                commit: None,
                version: "0.1.0",
                threads: 2,
            };
            serde_json::to_value(about).unwrap()
        };
        assert_eq!(json(Arithmetic::Int8)["arithmetic"], "int8");
        // Single precision is not told, so that stored figures stay as they are.
        assert_eq!(json(Arithmetic::F32).get("arithmetic"), None);
    }
}
