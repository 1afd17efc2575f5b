//! The threads that the core works with, in the process that runs.
//!
//! The core divides its work over rayon's common pool. A process that was forked has a copy of that
//! pool without its threads, and would wait for them for ever: there the work is done in a pool of its
//! own. Every binding that computes goes through [`work`], most by [`done`]; clippy refuses
//! `Python::detach` elsewhere.

use std::mem;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pythonize::pythonize;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;

use crate::error::PyError;

/// The process that worked first: the common pool's threads are, or will be, its own.
static FIRST: OnceLock<u32> = OnceLock::new();

/// The pool of a forked process, by the id of that process.
///
/// Locked only while attached to the interpreter: who forks is attached, too, so that no process is
/// born with this lock taken.
static FORKED: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Runs a job of the core, detached from the interpreter.
#[expect(clippy::disallowed_methods, reason = "this is the one place")]
pub fn work<T: Send>(py: Python<'_>, job: impl FnOnce() -> T + Send) -> PyResult<T> {
    let process = std::process::id();
    if *FIRST.get_or_init(|| process) == process {
        return Ok(py.detach(job));
    }
    let pool = pool_of(process)?;
    Ok(py.detach(|| pool.install(job)))
}

/// Runs a job of the core that may fail.
pub fn done<T: Send>(
    py: Python<'_>,
    job: impl FnOnce() -> Result<T, rsicalib::Error> + Send,
) -> PyResult<T> {
    Ok(work(py, job)?.map_err(PyError::from)?)
}

/// Runs a job of the core that may fail; what it has found, as a value of Python.
pub fn done_as_value<T: Send + Serialize>(
    py: Python<'_>,
    job: impl FnOnce() -> Result<T, rsicalib::Error> + Send,
) -> PyResult<Bound<'_, PyAny>> {
    Ok(pythonize(py, &done(py, job)?)?)
}

fn pool_of(process: u32) -> PyResult<Arc<ThreadPool>> {
    let mut pools = FORKED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((owner, pool)) = &*pools
        && *owner == process
    {
        return Ok(Arc::clone(pool));
    }
    let built = ThreadPoolBuilder::new().thread_name(|k| format!("rsicalib-{k}")).build();
    let pool = Arc::new(built.map_err(|error| {
        PyRuntimeError::new_err(format!("no threads can be started in process {process}: {error}"))
    })?);
    // What a parent left has no threads: to drop it would wait for them.
    mem::forget(pools.replace((process, Arc::clone(&pool))));
    Ok(pool)
}
