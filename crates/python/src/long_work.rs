//! Long work: without the interpreter lock, and on threads of this process.
//!
//! The threads of rayon's global pool belong to the process that used it first. A process that is forked from that one, as
//! `multiprocessing` does on Linux, has a copy of the pool without its threads, in which work would wait for ever: so it gets a
//! pool of its own.

use std::mem;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::GrimnetError;

/// Who does long work.
struct Owner {
    process_id: u32,
    /// `None`: on the global pool.
    own: Option<Arc<OwnPool>>,
}

/// The pool of a process that was forked.
struct OwnPool {
    pool: ThreadPool,
    /// One piece of work at a time: a thread of the pool that waits for a part of one would begin the next, and wait for what it
    /// holds itself.
    turn: Mutex<()>,
}

/// Of this process, or of the one that it was forked from. Locked with the interpreter lock held, so that no other thread has locked
/// it while the process is forked.
static OWNER: Mutex<Option<Owner>> = Mutex::new(None);

/// The pool of this process, `None` for the global one.
fn own_pool() -> PyResult<Option<Arc<OwnPool>>> {
    let mut owner = OWNER.lock().unwrap_or_else(PoisonError::into_inner);
    let process_id = process::id();
    let own = match owner.as_ref() {
        None => None,
        Some(owner) if owner.process_id == process_id => return Ok(owner.own.clone()),
        Some(_) => {
            let pool = ThreadPoolBuilder::new().build().map_err(|error| {
                GrimnetError::new_err(format!(
                    "the threads of a search cannot be started: {error}"
                ))
            })?;
            Some(Arc::new(OwnPool {
                pool,
                turn: Mutex::new(()),
            }))
        }
    };
    let before = owner.replace(Owner {
        process_id,
        own: own.clone(),
    });
    // Dropped, a pool waits for its threads, which are not in this process.
    mem::forget(before);
    Ok(own)
}

/// Does long work without the interpreter lock.
///
/// # Errors
/// That of the work; `GrimnetError` if threads cannot be started.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> PyResult<T> + Send) -> PyResult<T> {
    let own = own_pool()?;
    py.detach(|| match &own {
        Some(own) => {
            let _turn = own.turn.lock().unwrap_or_else(PoisonError::into_inner);
            own.pool.install(work)
        }
        None => work(),
    })
}

/// As [`detached`], for work that has threads of its own, which find no other pool than the global one.
///
/// # Errors
/// As [`detached`]; `GrimnetError` in a process that was forked from one that did long work.
pub fn detached_with_threads<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> PyResult<T> + Send,
) -> PyResult<T> {
    if own_pool()?.is_some() {
        return Err(GrimnetError::new_err(
            "this process was forked from one that has used grimnet, and lacks its threads; expected a process of its own: start it \
             with `multiprocessing.get_context(\"spawn\")`",
        ));
    }
    py.detach(work)
}
