//! Errors of starting the service.

use std::net::SocketAddr;

/// Why the service cannot start or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}; choose another address or port")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// Other machines could reach the service and no token protects it.
    #[error(
        "{address} can be reached from other machines; expected a token that clients must send, or an explicit permission to \
         serve everybody who reaches the address"
    )]
    Unprotected {
        /// The address.
        address: SocketAddr,
    },
    /// There is nothing to localise on.
    #[error("no maps to serve; expected at least one pack")]
    NoMaps,
    /// A map has no position on Earth.
    #[error(transparent)]
    Map(#[from] grimnet_geo::GeoError),
    /// A tile cannot be encoded.
    #[error("a picture of the map cannot be encoded: {0}")]
    Picture(#[from] image::ImageError),
    /// A track cannot be written.
    #[error("a track cannot be written: {0}")]
    Session(#[from] serde_json::Error),
    /// The system refuses threads, timers or signals.
    #[error("cannot run the service: {0}")]
    Run(#[from] std::io::Error),
}
