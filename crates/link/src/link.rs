//! A link to an autopilot that runs beside the work.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, Sender, channel},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use grimnet_track::{Input, TrackPoint};

use crate::{
    autopilot::Autopilot, clock::LinkClock, connection::Connection, error::LinkError,
    event::LinkEvent, exchange::exchange, options::LinkOptions, output::Output, session::Session,
};

/// The track at a time on the link's clock. It is called from the link's thread, up to 30 times a second.
pub type PointAt = Arc<dyn Fn(f64) -> Option<TrackPoint> + Send + Sync>;

/// How long to wait for a message before what is to be sent is looked at.
const WAIT: Duration = Duration::from_millis(5);

/// How a link stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkStatus {
    /// The autopilot that is heard.
    pub autopilot: Option<Autopilot>,
    /// The message that carries positions now. `None` while none is sent.
    pub sending: Option<Output>,
    /// How many positions were sent.
    pub sent: u64,
}

/// A link to an autopilot: reads its telemetry and sends it positions, on a thread of its own, until it is dropped.
///
/// It goes on whatever happens at the other end: an address that cannot be opened, a connection that breaks, an autopilot that
/// is silent or restarts are told as [`LinkEvent`]s and tried again.
#[derive(Debug)]
pub struct Link {
    inputs: Receiver<Input>,
    events: Receiver<LinkEvent>,
    status: Arc<Mutex<LinkStatus>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Link {
    /// Starts a link. Times are those of `clock`; positions are asked from `point_at` for the time of sending.
    ///
    /// # Errors
    /// [`LinkError::Thread`] if no thread can be started.
    pub fn start(
        options: LinkOptions,
        clock: LinkClock,
        point_at: PointAt,
    ) -> Result<Self, LinkError> {
        let (input_sender, inputs) = channel();
        let (event_sender, events) = channel();
        let status = Arc::new(Mutex::new(LinkStatus::default()));
        let stop = Arc::new(AtomicBool::new(false));
        let what = options.address.to_string();
        let worker = Worker {
            connection: Connection::new(options.address.clone(), options.signing.as_ref()),
            session: Session::new(options, clock.now_s()),
            clock,
            point_at,
            inputs: input_sender,
            events: event_sender,
            status: Arc::clone(&status),
            stop: Arc::clone(&stop),
        };
        let thread = thread::Builder::new()
            .name("link".to_owned())
            .spawn(move || worker.run())
            .map_err(|source| LinkError::Thread { what, source })?;
        Ok(Self {
            inputs,
            events,
            status,
            stop,
            thread: Some(thread),
        })
    }

    /// Telemetry that came since the last call, in order of arrival.
    pub fn inputs(&self) -> impl Iterator<Item = Input> + '_ {
        self.inputs.try_iter()
    }

    /// What happened since the last call.
    pub fn events(&self) -> impl Iterator<Item = LinkEvent> + '_ {
        self.events.try_iter()
    }

    /// How the link stands.
    #[must_use]
    pub fn status(&self) -> LinkStatus {
        *self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic there has nothing left to break.
            let _ = thread.join();
        }
    }
}

struct Worker {
    connection: Connection,
    session: Session,
    clock: LinkClock,
    point_at: PointAt,
    inputs: Sender<Input>,
    events: Sender<LinkEvent>,
    status: Arc<Mutex<LinkStatus>>,
    stop: Arc<AtomicBool>,
}

impl Worker {
    fn run(mut self) {
        while !self.stop.load(Ordering::Relaxed) {
            let mut events = exchange(
                &mut self.connection,
                &mut self.session,
                &self.clock,
                WAIT,
                &*self.point_at,
            );
            events.append(&mut self.session.events);
            // Whoever does not listen does not want to know.
            for event in events {
                let _ = self.events.send(event);
            }
            for input in self.session.inputs.drain(..) {
                let _ = self.inputs.send(input);
            }
            *self.status.lock().unwrap_or_else(PoisonError::into_inner) = LinkStatus {
                autopilot: self.session.autopilot(),
                sending: self.session.sending(),
                sent: self.session.sent(),
            };
        }
    }
}
