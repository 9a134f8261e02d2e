//! What all requests share.

use std::sync::Arc;

use tokio::sync::{Semaphore, watch};

use crate::access::Access;
use crate::admission::Admission;
use crate::limits::Limits;
use crate::maps::Maps;
use crate::metrics::Metrics;
use crate::tile_cache::TileCache;
use crate::track_store::Tracks;

/// The running service, as request handlers see it.
#[derive(Debug)]
pub(crate) struct State {
    pub maps: Maps,
    pub limits: Limits,
    pub localisations: Arc<Admission>,
    /// Answers that are written in another format.
    pub conversions: Arc<Admission>,
    pub metrics: Metrics,
    pub tracks: Tracks,
    /// Clients that may follow tracks.
    pub listeners: Arc<Semaphore>,
    /// Becomes true when the service stops.
    pub stopping: watch::Receiver<bool>,
    pub tiles: TileCache,
    /// Tiles and tracks as text that are made at the same time.
    pub background: Arc<Semaphore>,
    pub access: Access,
}

/// The state of a request handler.
pub(crate) type Shared = axum::extract::State<Arc<State>>;
