//! Work beside localisations that takes a while: tiles, and tracks as text.

use std::sync::Arc;

use crate::problem::Problem;
use crate::state::State;

/// Runs `work` on a thread of its own, where it keeps no other request waiting; not more at once than localisations.
///
/// # Errors
/// What `work` returns; status 500 if it panics.
pub(crate) async fn in_background<T: Send + 'static>(
    state: &Arc<State>,
    work: impl FnOnce(&State) -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let Ok(place) = state.background.clone().acquire_owned().await else {
        return Err(Problem::internal());
    };
    let shared = state.clone();
    let work = move || {
        let _place = place;
        work(&shared)
    };
    tokio::task::spawn_blocking(work).await.map_err(|error| {
        tracing::error!(%error, "work in the background failed");
        Problem::internal()
    })?
}
