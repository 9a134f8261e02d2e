//! Handing frames from the thread that reads them to the flight.

use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What becomes of an item that waits while another one comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// It is taken first, and the other one waits: of a recorded flight nothing is lost.
    All,
    /// It is dropped: what comes while the aircraft flies is of use while it is new.
    Newest,
}

#[derive(Debug)]
struct State<T> {
    waiting: Option<T>,
    dropped: usize,
    /// Whether both ends are there.
    is_open: bool,
}

#[derive(Debug)]
struct Shared<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

impl<T> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn close(&self) {
        self.lock().is_open = false;
        self.changed.notify_all();
    }
}

/// The end of the thread that reads.
#[derive(Debug)]
pub struct Giver<T>(Arc<Shared<T>>);

/// The end of the flight.
#[derive(Debug)]
pub struct Taker<T>(Arc<Shared<T>>);

/// Both ends of a place where one item waits.
pub fn handover<T>() -> (Giver<T>, Taker<T>) {
    let shared = Arc::new(Shared {
        state: Mutex::new(State {
            waiting: None,
            dropped: 0,
            is_open: true,
        }),
        changed: Condvar::new(),
    });
    (Giver(Arc::clone(&shared)), Taker(shared))
}

impl<T> Giver<T> {
    /// Hands an item over. Gives whether there is still somebody to take it.
    pub fn give(&self, item: T, keep: Keep) -> bool {
        let mut state = self.0.lock();
        if keep == Keep::All {
            let has_to_wait = |state: &mut State<T>| state.is_open && state.waiting.is_some();
            let waited = self.0.changed.wait_while(state, has_to_wait);
            state = waited.unwrap_or_else(PoisonError::into_inner);
        }
        if !state.is_open {
            return false;
        }
        state.dropped += usize::from(state.waiting.replace(item).is_some());
        self.0.changed.notify_all();
        true
    }
}

impl<T> Taker<T> {
    /// The item that waits, or that comes within `patience`.
    ///
    /// # Errors
    /// None came, or none comes any more.
    pub fn take(&self, patience: Duration) -> Result<T, RecvTimeoutError> {
        let has_to_wait = |state: &mut State<T>| state.is_open && state.waiting.is_none();
        let waited = self
            .0
            .changed
            .wait_timeout_while(self.0.lock(), patience, has_to_wait);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let taken = state.waiting.take();
        self.0.changed.notify_all();
        match taken {
            Some(item) => Ok(item),
            None if state.is_open => Err(RecvTimeoutError::Timeout),
            None => Err(RecvTimeoutError::Disconnected),
        }
    }

    /// How many items were dropped for newer ones.
    pub fn dropped(&self) -> usize {
        self.0.lock().dropped
    }
}

impl<T> Drop for Giver<T> {
    fn drop(&mut self) {
        self.0.close();
    }
}

impl<T> Drop for Taker<T> {
    fn drop(&mut self) {
        self.0.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn the_newest_item_replaces_the_one_that_waits() {
        let (giver, taker) = handover();
        for item in 0..5 {
            assert!(giver.give(item, Keep::Newest));
        }
        assert_eq!(taker.take(Duration::ZERO), Ok(4));
        assert_eq!(taker.dropped(), 4);
        let nothing = taker.take(Duration::from_millis(1));
        assert_eq!(nothing, Err(RecvTimeoutError::Timeout));
        giver.give(5, Keep::Newest);
        drop(giver);
        assert_eq!(taker.take(PATIENCE), Ok(5));
        assert_eq!(taker.take(PATIENCE), Err(RecvTimeoutError::Disconnected));
    }

    #[test]
    fn all_items_are_taken_where_all_are_kept() {
        let (giver, taker) = handover();
        let thread = thread::spawn(move || (0..50).all(|item| giver.give(item, Keep::All)));
        let taken: Vec<i32> = std::iter::from_fn(|| taker.take(PATIENCE).ok()).collect();
        assert_eq!(taken, (0..50).collect::<Vec<_>>());
        assert_eq!(taker.dropped(), 0);
        assert!(thread.join().unwrap());
    }

    #[test]
    fn who_gives_does_not_wait_for_a_flight_that_has_ended() {
        let (giver, taker) = handover();
        giver.give(1, Keep::All);
        let thread = thread::spawn(move || giver.give(2, Keep::All));
        drop(taker);
        assert!(!thread.join().unwrap());
    }
}
