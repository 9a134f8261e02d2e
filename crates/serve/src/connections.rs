//! Accepts connections and answers on them until the service is stopped.

use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulConnection, GracefulShutdown};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;

use crate::lingering_close::LingeringClose;
use crate::stall_guard::StallGuard;
use crate::state::State;

/// Largest head of a request, bytes.
const MAX_HEAD_BYTES: usize = 64 << 10;

/// Most headers of a request.
const MAX_HEADERS: usize = 100;

/// Pause after the system refused a connection, such as without free file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Answers connections until `stopped` is ready; open requests then have some time to end.
pub(crate) async fn accept(
    listener: TcpListener,
    router: Router,
    state: Arc<State>,
    stopped: impl Future<Output = ()>,
) {
    let places = Arc::new(Semaphore::new(state.limits.connections));
    let graceful = GracefulShutdown::new();
    let mut stopped = std::pin::pin!(stopped);
    loop {
        let next = async {
            let place = places.clone().acquire_owned().await;
            (place, listener.accept().await)
        };
        let (place, accepted) = tokio::select! {
            next = next => next,
            () = &mut stopped => break,
        };
        let stream = match accepted {
            Ok((stream, _)) => stream,
            Err(error) => {
                tracing::warn!(%error, "a connection cannot be accepted");
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let connection = graceful.watch(connection(stream, &router, &state));
        let state = state.clone();
        tokio::spawn(async move {
            state.metrics.connections.fetch_add(1, Ordering::Relaxed);
            if let Err(error) = connection.await {
                tracing::debug!(%error, "a connection ended");
            }
            state.metrics.connections.fetch_sub(1, Ordering::Relaxed);
            drop(place);
        });
    }
    drop(listener);
    let end_time = state.limits.end_time();
    if tokio::time::timeout(end_time, graceful.shutdown())
        .await
        .is_err()
    {
        tracing::warn!(
            "requests did not end within {} s and are dropped",
            end_time.as_secs()
        );
    }
}

/// Answers the requests of one connection.
fn connection(
    stream: TcpStream,
    router: &Router,
    state: &State,
) -> impl GracefulConnection<Error = hyper::Error> + Send + use<> {
    // Answers are small and complete: they are not to wait for more.
    let _ = stream.set_nodelay(true);
    let stream = StallGuard::new(stream, state.limits.write_pause);
    let stream = LingeringClose::new(stream, &state.limits);
    let unread = stream.unread();
    let router = TowerToHyperService::new(router.clone());
    let service = service_fn(move |mut request: hyper::Request<hyper::body::Incoming>| {
        request.extensions_mut().insert(unread.clone());
        router.call(request)
    });
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(state.limits.head_time)
        .max_header_size(MAX_HEAD_BYTES)
        .max_headers(MAX_HEADERS)
        .serve_connection(TokioIo::new(stream), service)
}
