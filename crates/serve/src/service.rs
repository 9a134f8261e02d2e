//! The service as a program starts and stops it.

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;

use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, watch};

use crate::access::Access;
use crate::admission::{Admission, Work};
use crate::answers_route::MAX_ANSWERS_BYTES;
use crate::connections;
use crate::error::ServeError;
use crate::limits::Limits;
use crate::maps::{Maps, ServedMap};
use crate::metrics::Metrics;
use crate::router::router;
use crate::state::State;
use crate::tile_cache::TileCache;
use crate::track_store::Tracks;

/// A service that listens and does not answer yet.
#[derive(Debug)]
pub struct Service {
    listener: TcpListener,
    address: SocketAddr,
    state: Arc<State>,
    stop: Arc<watch::Sender<bool>>,
}

/// Stops a service from another thread.
#[derive(Debug, Clone)]
pub struct StopHandle(Arc<watch::Sender<bool>>);

impl StopHandle {
    /// Open requests are answered, new ones are not accepted.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

impl Service {
    /// Listens on `address`; port 0 takes a free port.
    ///
    /// # Errors
    /// Returns an error if there is no map, the address cannot be listened on, or others could reach it and `access` does not
    /// allow them to.
    pub fn bind(
        address: SocketAddr,
        access: Access,
        maps: Vec<ServedMap>,
        limits: Limits,
    ) -> Result<Self, ServeError> {
        if matches!(access, Access::ThisMachine) && !address.ip().is_loopback() {
            return Err(ServeError::Unprotected { address });
        }
        let maps = Maps::new(maps)?;
        let listener =
            TcpListener::bind(address).map_err(|source| ServeError::Listen { address, source })?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let stop = Arc::new(watch::Sender::new(false));
        let state = State {
            maps,
            background: Arc::new(Semaphore::new(limits.at_once.max(1))),
            tracks: Tracks::default(),
            listeners: Arc::new(Semaphore::new(limits.listeners)),
            stopping: stop.subscribe(),
            tiles: TileCache::default(),
            localisations: Admission::new(Work::Localisation, &limits, limits.max_body_bytes),
            conversions: Admission::new(Work::Conversion, &limits, MAX_ANSWERS_BYTES),
            limits,
            metrics: Metrics::default(),
            access,
        };
        Ok(Self {
            listener,
            address,
            state: Arc::new(state),
            stop,
        })
    }

    /// The address that it listens on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Stops the service while it runs.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        StopHandle(self.stop.clone())
    }

    /// Answers requests until it is stopped. SIGTERM and SIGINT stop it too if `ends_by_signal` is set; the second one ends it
    /// without waiting for open requests.
    ///
    /// # Errors
    /// Returns an error if the system refuses threads, timers or signals.
    pub fn run(self, ends_by_signal: bool) -> Result<(), ServeError> {
        let runtime = Runtime::new()?;
        let stop = self.stop.clone();
        let served = runtime.block_on(async move {
            let listener = tokio::net::TcpListener::from_std(self.listener)?;
            let mut stopped = self.stop.subscribe();
            let stopped = async move {
                // An error says that nobody can stop it any more.
                if stopped.wait_for(|stop| *stop).await.is_err() {
                    std::future::pending::<()>().await;
                }
            };
            let router = router(self.state.clone());
            let accepting = connections::accept(listener, router, self.state, stopped);
            if ends_by_signal {
                let second = signals(stop)?;
                tokio::select! {
                    () = accepting => {}
                    () = second => tracing::warn!("ended by a second signal"),
                }
            } else {
                accepting.await;
            }
            Ok::<(), ServeError>(())
        });
        // A localisation that nobody waits for is not waited for.
        runtime.shutdown_background();
        served
    }
}

/// The first signal stops the service; the returned future is ready at the second one.
#[cfg(unix)]
fn signals(stop: Arc<watch::Sender<bool>>) -> std::io::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};

    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    Ok(async move {
        for number in 0..2 {
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
            }
            if number == 0 {
                tracing::info!("stopping; open requests are answered");
                stop.send_replace(true);
            }
        }
    })
}

/// The first Ctrl-C stops the service; the returned future is ready at the second one.
#[cfg(not(unix))]
fn signals(stop: Arc<watch::Sender<bool>>) -> std::io::Result<impl Future<Output = ()>> {
    Ok(async move {
        for number in 0..2 {
            if tokio::signal::ctrl_c().await.is_err() {
                std::future::pending::<()>().await;
            }
            if number == 0 {
                tracing::info!("stopping; open requests are answered");
                stop.send_replace(true);
            }
        }
    })
}
