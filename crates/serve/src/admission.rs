//! How many requests of one kind of work run and wait at the same time.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::limits::Limits;
use crate::problem::{Problem, ProblemKind};

/// Longest time in a `Retry-After`, seconds.
const MAX_RETRY_AFTER_S: f64 = 60.0;

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
    /// Mean duration of the work, microseconds.
    mean_us: AtomicU64,
}

/// The right to do the work once, now or when a worker is free. Given back when dropped.
#[derive(Debug)]
pub(crate) struct Place {
    admission: Arc<Admission>,
    permit: OwnedSemaphorePermit,
}

impl Admission {
    /// Admits `limits.at_once` that run and `limits.queue` that wait.
    pub(crate) fn new(work: Work, limits: &Limits) -> Arc<Self> {
        let workers = limits.at_once.max(1);
        let places = workers + limits.queue;
        Arc::new(Self {
            work,
            places: Arc::new(Semaphore::new(places)),
            workers: Arc::new(Semaphore::new(workers)),
            all_places: places,
            all_workers: workers,
            mean_us: AtomicU64::new(0),
        })
    }

    /// A place, before the body of the request is read: so all bodies together take bounded memory.
    ///
    /// # Errors
    /// Status 503 with `Retry-After` if all places are taken.
    pub(crate) fn enter(self: &Arc<Self>) -> Result<Place, Problem> {
        match self.places.clone().try_acquire_owned() {
            Ok(permit) => Ok(Place {
                admission: self.clone(),
                permit,
            }),
            Err(_) => Err(Problem::unavailable(
                ProblemKind::Busy,
                format!(
                    "{} {} run and {} wait; send the request again later",
                    self.all_workers,
                    self.work.plural(),
                    self.all_places - self.all_workers
                ),
                self.retry_after_s(),
            )),
        }
    }

    /// Requests whose work runs now.
    pub(crate) fn running(&self) -> usize {
        self.all_workers - self.workers.available_permits()
    }

    /// Requests that hold a place and do not run: their body arrives, or they wait.
    pub(crate) fn waiting(&self) -> usize {
        let inside = self.all_places - self.places.available_permits();
        inside.saturating_sub(self.running())
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

impl Place {
    /// Runs `work` on a thread of its own as soon as a worker is free. The worker and the place are given back when the work
    /// ends, also if nobody waits for it any more.
    ///
    /// # Errors
    /// Status 503 if it does not end within `limits.locate_time`, 500 if it panics.
    pub(crate) async fn run<T: Send + 'static>(
        self,
        limits: &Limits,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let kind = self.admission.work;
        let running = async {
            let Self { admission, permit } = self;
            let Ok(worker) = admission.workers.clone().acquire_owned().await else {
                return Err(Problem::internal());
            };
            let work = move || {
                let start = Instant::now();
                let result = work();
                admission.took(start);
                drop((worker, permit));
                result
            };
            tokio::task::spawn_blocking(work).await.map_err(|error| {
                tracing::error!(%error, work = kind.plural(), "work failed");
                Problem::internal()
            })
        };
        match tokio::time::timeout(limits.locate_time, running).await {
            Ok(result) => result,
            Err(_) => Err(Problem::unavailable(
                ProblemKind::TimeLimit,
                format!(
                    "no answer after {} s; {}",
                    limits.locate_time.as_secs_f64(),
                    kind.advice()
                ),
                retry_after_time_limit_s(limits),
            )),
        }
    }
}

/// What took too long is worth another try when the service is less busy.
fn retry_after_time_limit_s(limits: &Limits) -> u64 {
    limits
        .locate_time
        .as_secs()
        .clamp(1, MAX_RETRY_AFTER_S as u64)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn limits(at_once: usize, queue: usize) -> Limits {
        Limits {
            at_once,
            queue,
            ..Limits::default()
        }
    }

    #[tokio::test]
    async fn places_are_counted_and_given_back() {
        let limits = limits(1, 2);
        let admission = Admission::new(Work::Localisation, &limits);
        let first = admission.enter().unwrap();
        let _others = [admission.enter().unwrap(), admission.enter().unwrap()];
        assert!(admission.enter().is_err());
        assert_eq!((admission.running(), admission.waiting()), (0, 3));
        assert_eq!(first.run(&limits, || 7).await, Ok(7));
        assert_eq!(admission.waiting(), 2);
        assert!(admission.enter().is_ok());
    }

    #[tokio::test]
    async fn work_that_takes_too_long_keeps_its_worker_until_it_ends() {
        let limits = Limits {
            locate_time: Duration::from_millis(200),
            ..limits(1, 1)
        };
        let admission = Admission::new(Work::Localisation, &limits);
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let late = admission
            .enter()
            .unwrap()
            .run(&limits, move || ended.recv())
            .await;
        assert!(late.is_err());
        assert_eq!(admission.running(), 1);
        // The next one waits in vain for the worker, and gives its place back.
        let waits = admission.enter().unwrap().run(&limits, || ()).await;
        assert!(waits.is_err());
        end.send(()).unwrap();
        let next = Limits {
            locate_time: Duration::from_secs(30),
            ..limits
        };
        assert_eq!(admission.enter().unwrap().run(&next, || 3).await, Ok(3));
    }

    #[tokio::test]
    async fn a_panic_is_an_answer_and_frees_the_worker() {
        let limits = limits(1, 0);
        let admission = Admission::new(Work::Localisation, &limits);
        for _ in 0..3 {
            let place = admission.enter().unwrap();
            let result: Result<(), _> = place.run(&limits, || panic!("in a test")).await;
            assert!(result.is_err());
        }
    }
}
