//! Work on all cores, and what workers share.
//!
//! The library that shares out the work is called in two places of this file, with work of one type:
//! called from every loop, its code was compiled for each of them, a tenth of the crate.

use std::sync::Mutex;

use rayon::prelude::*;

/// Locks a mutex, also after a panic in another thread.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// `job` of each item, on all cores; the answers stand in the order of the items.
pub(crate) fn map<I: Send, T: Send>(
    items: impl IntoIterator<Item = I>,
    job: impl Fn(I) -> T + Sync,
) -> Vec<T> {
    let open = |item| (Mutex::new(Some(item)), Mutex::new(None));
    let slots: Vec<_> = items.into_iter().map(open).collect();
    each(slots.len(), &|k| {
        let (item, answer) = &slots[k];
        let item = lock(item).take();
        let made = item.map(&job);
        *lock(answer) = made;
    });
    let answers = slots.into_iter().map(|(_, answer)| answer.into_inner());
    answers.filter_map(|a| a.unwrap_or_else(std::sync::PoisonError::into_inner)).collect()
}

/// Both of two pieces of work, side by side.
pub(crate) fn both<A: Send, B: Send>(
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    rayon::join(a, b)
}

fn each(count: usize, job: &(dyn Fn(usize) + Sync)) {
    if count == 1 {
        return job(0);
    }
    (0..count).into_par_iter().for_each(job);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_stand_in_the_order_of_the_items() {
        let squares: Vec<usize> = (0..1000).map(|k| k * k).collect();
        assert_eq!(map(0..1000, |k: usize| k * k), squares);
    }

    #[test]
    fn work_within_work_ends() {
        let sums = map(0..20_u32, |k| map(0..k, |j| j).into_iter().sum::<u32>());
        assert_eq!(sums, (0..20_u32).map(|k| k * k.saturating_sub(1) / 2).collect::<Vec<u32>>());
    }

    #[test]
    fn borrowed_items_are_changed_in_place() {
        let mut all = vec![1.0; 10];
        map(all.chunks_mut(3), |part| part.fill(2.0));
        assert_eq!(all, vec![2.0; 10]);
    }
}
