//! Errors of this crate.

/// Why an answer cannot be written in a format.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnswerError {
    /// JSON or GeoJSON.
    #[error("cannot write an answer as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// Comma-separated values.
    #[error("cannot write an answer as CSV: {0}")]
    Csv(#[from] csv::Error),
    /// KML or GPX.
    #[error("cannot write an answer as XML: {0}")]
    Xml(#[from] std::io::Error),
    /// GeoPackage.
    #[cfg(feature = "geopackage")]
    #[error("cannot write answers as a GeoPackage: {0}")]
    Database(#[from] rusqlite::Error),
}

/// A result of this crate.
pub(crate) type Result<T> = std::result::Result<T, AnswerError>;
