//! How many requests of one kind of work run and wait at the same time.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use crate::limits::Limits;
use crate::problem::{Problem, ProblemKind};

/// Longest time in a `Retry-After`, seconds.
const MAX_RETRY_AFTER_S: f64 = 60.0;

/// Memory of the answers that clients have not taken yet, times that of all bodies.
const ANSWERS_PER_BODIES: usize = 4;

/// Work that is admitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Work {
    /// A photo is decoded and localised.
    Localisation,
    /// Answers are written in another format.
    Conversion,
}

impl Work {
    /// Several of them.
    fn plural(self) -> &'static str {
        match self {
            Self::Localisation => "localisations",
            Self::Conversion => "conversions of answers",
        }
    }

    /// What makes it shorter.
    fn advice(self) -> &'static str {
        match self {
            Self::Localisation => {
                "a heading, a height or an area (`near`) makes the search shorter"
            }
            Self::Conversion => "send fewer answers",
        }
    }
}

/// Counts the places of those that run and wait, and hands them out.
#[derive(Debug)]
pub(crate) struct Admission {
    work: Work,
    places: Arc<Semaphore>,
    workers: Arc<Semaphore>,
    all_places: usize,
    all_workers: usize,
    /// Requests whose body arrives, and those that have a place.
    requests: AtomicUsize,
    /// Bytes of their bodies so far.
    body_bytes: AtomicUsize,
    max_body_bytes: usize,
    /// Bytes of the answers that clients have not taken yet, of those that are held.
    answer_bytes: AtomicUsize,
    /// Mean duration of the work, microseconds.
    mean_us: AtomicU64,
}

/// A request whose body arrives. It has no place yet: a client that sends slowly keeps nobody out of one, but what it has sent counts for
/// the memory of all bodies. Clones are the same request; what it took is given back when the last one is dropped.
#[derive(Debug, Clone)]
pub(crate) struct Arrival(Arc<Arriving>);

#[derive(Debug)]
struct Arriving {
    admission: Arc<Admission>,
    /// Bytes of the body so far.
    bytes: AtomicUsize,
}

/// An answer that counts until it is sent: a client may take it slowly.
struct Held {
    admission: Arc<Admission>,
    text: String,
}

/// The right to do the work once, now or when a worker is free. Given back when dropped.
#[derive(Debug)]
pub(crate) struct Place {
    arrival: Arrival,
    permit: OwnedSemaphorePermit,
    /// When it was taken.
    since: Instant,
    /// Time for the work from then on.
    limit: Duration,
}

impl Admission {
    /// Admits `limits.at_once` that run and `limits.queue` that wait. Their bodies and those that arrive take as much memory as a body
    /// of `largest_body_bytes` for each of these.
    pub(crate) fn new(work: Work, limits: &Limits, largest_body_bytes: usize) -> Arc<Self> {
        let workers = limits.at_once.max(1);
        let places = workers
            .saturating_add(limits.queue)
            .min(Semaphore::MAX_PERMITS);
        Arc::new(Self {
            work,
            places: Arc::new(Semaphore::new(places)),
            workers: Arc::new(Semaphore::new(workers)),
            all_places: places,
            all_workers: workers,
            requests: AtomicUsize::new(0),
            body_bytes: AtomicUsize::new(0),
            max_body_bytes: largest_body_bytes.saturating_mul(places),
            answer_bytes: AtomicUsize::new(0),
            mean_us: AtomicU64::new(0),
        })
    }

    /// A request, before its body is read.
    ///
    /// # Errors
    /// Status 503 with `Retry-After` if all places are taken now: the body need not be sent in vain.
    pub(crate) fn arrive(self: &Arc<Self>) -> Result<Arrival, Problem> {
        if self.places.available_permits() == 0 {
            return Err(self.full());
        }
        self.requests.fetch_add(1, Ordering::Relaxed);
        Ok(Arrival(Arc::new(Arriving {
            admission: self.clone(),
            bytes: AtomicUsize::new(0),
        })))
    }

    fn full(&self) -> Problem {
        self.busy(format!(
            "{} {} run and {} wait; send the request again later",
            self.all_workers,
            self.work.plural(),
            self.all_places - self.all_workers
        ))
    }

    fn busy(&self, detail: impl std::fmt::Display) -> Problem {
        Problem::unavailable(ProblemKind::Busy, detail, self.retry_after_s())
    }

    /// An answer to send, which counts until the client has taken it. One is held however long it is.
    ///
    /// # Errors
    /// Status 503 with `Retry-After` if the answers that clients have not taken yet take too much memory with it.
    pub(crate) fn hold(self: &Arc<Self>, text: String) -> Result<Bytes, Problem> {
        let bytes = text.len();
        let before = self.answer_bytes.fetch_add(bytes, Ordering::Relaxed);
        let held = Held {
            admission: self.clone(),
            text,
        };
        let most = self.max_body_bytes.saturating_mul(ANSWERS_PER_BODIES);
        if before > 0 && before + bytes > most {
            return Err(self.busy(
                "answers that other clients have not taken yet take all memory for them; send the request again later",
            ));
        }
        Ok(Bytes::from_owner(held))
    }

    /// Requests whose work runs now.
    pub(crate) fn running(&self) -> usize {
        self.all_workers - self.workers.available_permits()
    }

    /// Requests that do not run: their body arrives, or they wait.
    pub(crate) fn waiting(&self) -> usize {
        let requests = self.requests.load(Ordering::Relaxed);
        requests.saturating_sub(self.running())
    }

    /// Bytes of the bodies that arrive, wait or are worked on.
    pub(crate) fn body_bytes(&self) -> usize {
        self.body_bytes.load(Ordering::Relaxed)
    }

    /// Seconds until a place is probably free: the time that the waiting ones take.
    fn retry_after_s(&self) -> u64 {
        let mean_s = self.mean_us.load(Ordering::Relaxed) as f64 * 1e-6;
        let rounds = self.all_places as f64 / self.all_workers as f64;
        (mean_s * rounds).ceil().clamp(1.0, MAX_RETRY_AFTER_S) as u64
    }

    fn took(&self, start: Instant) {
        let us = start.elapsed().as_micros() as u64;
        let mean = self.mean_us.load(Ordering::Relaxed);
        // Two updates at once may lose one of them: it is an estimate.
        let mean = if mean == 0 { us } else { (7 * mean + us) / 8 };
        self.mean_us.store(mean, Ordering::Relaxed);
    }
}

impl Arrival {
    /// Counts bytes of the body that came.
    ///
    /// # Errors
    /// Status 503 with `Retry-After` if the bodies of all requests together take too much memory then.
    pub(crate) fn take(&self, bytes: usize) -> Result<(), Problem> {
        let Arriving {
            admission,
            bytes: of_body,
        } = &*self.0;
        let before = admission.body_bytes.fetch_add(bytes, Ordering::Relaxed);
        of_body.fetch_add(bytes, Ordering::Relaxed);
        if before + bytes > admission.max_body_bytes {
            return Err(admission.busy(
                "other requests take all memory for the bodies of requests; send the request again later",
            ));
        }
        Ok(())
    }

    /// A place, when the body is there. The time limit of the work begins.
    ///
    /// # Errors
    /// Status 503 with `Retry-After` if all places are taken.
    pub(crate) fn enter(self, limits: &Limits) -> Result<Place, Problem> {
        let admission = &self.0.admission;
        let Ok(permit) = admission.places.clone().try_acquire_owned() else {
            return Err(admission.full());
        };
        Ok(Place {
            arrival: self,
            permit,
            since: Instant::now(),
            limit: limits.locate_time,
        })
    }
}

impl AsRef<[u8]> for Held {
    fn as_ref(&self) -> &[u8] {
        self.text.as_bytes()
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let bytes = self.text.len();
        self.admission
            .answer_bytes
            .fetch_sub(bytes, Ordering::Relaxed);
    }
}

impl Drop for Arriving {
    fn drop(&mut self) {
        let Admission {
            requests,
            body_bytes,
            ..
        } = &*self.admission;
        requests.fetch_sub(1, Ordering::Relaxed);
        body_bytes.fetch_sub(*self.bytes.get_mut(), Ordering::Relaxed);
    }
}

impl Place {
    /// What `waiting` gives, if it comes before the time limit of the work.
    pub(crate) async fn wait<T>(&self, waiting: impl Future<Output = T>) -> Option<T> {
        timeout(self.time_left(), waiting).await.ok()
    }

    fn time_left(&self) -> Duration {
        self.limit.saturating_sub(self.since.elapsed())
    }

    /// Runs `work` on a thread of its own as soon as a worker is free. The worker and the place are given back when the work
    /// ends, also if nobody waits for it any more.
    ///
    /// # Errors
    /// Status 503 if it does not end within [`Limits::locate_time`] from when the place was taken, 500 if it panics.
    pub(crate) async fn run<T: Send + 'static>(
        self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let time_left = self.time_left();
        let Self {
            arrival,
            permit,
            limit,
            ..
        } = self;
        let admission = arrival.0.admission.clone();
        let kind = admission.work;
        let running = async {
            let workers = admission.workers.clone();
            let Ok(worker) = workers.acquire_owned().await else {
                return Err(Problem::internal());
            };
            let work = move || {
                let start = Instant::now();
                let result = work();
                arrival.0.admission.took(start);
                drop((worker, permit, arrival));
                result
            };
            tokio::task::spawn_blocking(work).await.map_err(|error| {
                tracing::error!(%error, work = kind.plural(), "work failed");
                Problem::internal()
            })
        };
        match timeout(time_left, running).await {
            Ok(result) => result,
            Err(_) => Err(Problem::unavailable(
                ProblemKind::TimeLimit,
                format!(
                    "no answer after {} s; {}",
                    limit.as_secs_f64(),
                    kind.advice()
                ),
                retry_after_time_limit_s(limit),
            )),
        }
    }
}

/// What took too long is worth another try when the service is less busy.
fn retry_after_time_limit_s(limit: Duration) -> u64 {
    limit.as_secs().clamp(1, MAX_RETRY_AFTER_S as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(at_once: usize, queue: usize) -> Limits {
        Limits {
            at_once,
            queue,
            ..Limits::default()
        }
    }

    fn admission(limits: &Limits) -> Arc<Admission> {
        Admission::new(Work::Localisation, limits, 1000)
    }

    fn place(admission: &Arc<Admission>, limits: &Limits) -> Result<Place, Problem> {
        admission.arrive()?.enter(limits)
    }

    #[tokio::test]
    async fn places_are_counted_and_given_back() {
        let limits = limits(1, 2);
        let admission = admission(&limits);
        let late = admission.arrive().unwrap();
        let mut places: Vec<_> = (0..3)
            .map(|_| place(&admission, &limits).unwrap())
            .collect();
        assert!(admission.arrive().is_err(), "its body is not read");
        assert!(late.enter(&limits).is_err());
        assert_eq!((admission.running(), admission.waiting()), (0, 3));
        assert_eq!(places.remove(0).run(|| 7).await, Ok(7));
        assert_eq!(admission.waiting(), 2);
        assert!(place(&admission, &limits).is_ok());
    }

    #[test]
    fn any_number_may_wait() {
        let limits = limits(2, usize::MAX);
        let admission = admission(&limits);
        let places: Vec<_> = (0..3)
            .map(|_| place(&admission, &limits).unwrap())
            .collect();
        assert_eq!(admission.waiting(), places.len());
    }

    #[test]
    fn bodies_take_bounded_memory_and_no_place_before_they_are_there() {
        let limits = limits(1, 1);
        let admission = admission(&limits);
        let mut arriving: Vec<_> = (0..100).map(|_| admission.arrive().unwrap()).collect();
        for arrival in &arriving[..4] {
            arrival.take(400).unwrap();
        }
        assert!(arriving[4].take(401).is_err());
        arriving.remove(4);
        arriving[4].take(400).unwrap();
        assert_eq!((admission.body_bytes(), admission.waiting()), (2000, 99));
        // They count as long as the place is held.
        let place = arriving.remove(0).enter(&limits).unwrap();
        drop(arriving);
        assert_eq!((admission.body_bytes(), admission.waiting()), (400, 1));
        drop(place);
        assert_eq!((admission.body_bytes(), admission.waiting()), (0, 0));
    }

    #[test]
    fn answers_that_are_not_taken_take_bounded_memory() {
        let limits = limits(1, 1);
        let admission = admission(&limits);
        let hold = |bytes: usize| admission.hold("x".repeat(bytes));
        let long = hold(100_000).unwrap();
        assert!(hold(1).is_err());
        drop(long);
        let held: Vec<_> = (0..4).map(|_| hold(2000).unwrap()).collect();
        assert!(hold(1).is_err());
        drop(held);
        assert_eq!(hold(3).unwrap(), "xxx");
    }

    #[tokio::test]
    async fn what_is_waited_for_before_the_work_counts_too() {
        let limits = Limits {
            locate_time: Duration::from_millis(500),
            ..limits(1, 0)
        };
        let place = place(&admission(&limits), &limits).unwrap();
        assert_eq!(place.wait(std::future::pending::<()>()).await, None);
        let work = || std::thread::sleep(Duration::from_millis(250));
        assert!(place.run(work).await.is_err(), "no time is left");
    }

    #[tokio::test]
    async fn work_that_takes_too_long_keeps_its_worker_until_it_ends() {
        let limits = Limits {
            locate_time: Duration::from_millis(200),
            ..limits(1, 1)
        };
        let admission = admission(&limits);
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let late = place(&admission, &limits)
            .unwrap()
            .run(move || ended.recv())
            .await;
        assert!(late.is_err());
        assert_eq!(admission.running(), 1);
        // The next one waits in vain for the worker, and gives its place back.
        let waits = place(&admission, &limits).unwrap().run(|| ()).await;
        assert!(waits.is_err());
        end.send(()).unwrap();
        let next = Limits {
            locate_time: Duration::from_secs(30),
            ..limits
        };
        assert_eq!(place(&admission, &next).unwrap().run(|| 3).await, Ok(3));
    }

    #[tokio::test]
    async fn a_panic_is_an_answer_and_frees_the_worker() {
        let limits = limits(1, 0);
        let admission = admission(&limits);
        for _ in 0..3 {
            let place = place(&admission, &limits).unwrap();
            let result: Result<(), _> = place.run(|| panic!("in a test")).await;
            assert!(result.is_err());
        }
    }
}
