//! What all requests share.

use std::sync::Arc;

use tokio::sync::{Semaphore, watch};

use crate::admission::Admission;
use crate::limits::Limits;
use crate::maps::Maps;
use crate::metrics::Metrics;
use crate::tile_cache::TileCache;
use crate::token::Token;
use crate::track_store::Tracks;

/// The running service, as request handlers see it.
#[derive(Debug)]
pub(crate) struct State {
    pub maps: Maps,
    pub limits: Limits,
    pub admission: Arc<Admission>,
    pub metrics: Metrics,
    pub tracks: Tracks,
    /// Clients that may follow tracks.
    pub listeners: Arc<Semaphore>,
    /// Becomes true when the service stops.
    pub stopping: watch::Receiver<bool>,
    pub tiles: TileCache,
    /// Work in the background that runs at the same time.
    pub background: Arc<Semaphore>,
    pub token: Option<Token>,
    /// Only this machine reaches the service.
    pub is_local: bool,
}

/// The state of a request handler.
pub(crate) type Shared = axum::extract::State<Arc<State>>;
