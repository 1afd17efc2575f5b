//! What workers share: a lock that stays usable after a panic in another thread.

use std::sync::Mutex;

/// Locks a mutex, also after a panic in another thread.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
