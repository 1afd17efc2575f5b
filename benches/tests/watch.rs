//! The watch allocates no memory once it runs.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use rsicalib_benches::watched;

thread_local! {
    /// Allocations of this thread: those of the test harness are none of ours.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting.
struct Counting;

#[expect(unsafe_code, reason = "an allocator cannot be written without")]
// SAFETY: every call is passed on as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        unsafe { System.dealloc(old, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn allocations(mut run: impl FnMut()) -> usize {
    let before = COUNT.get();
    run();
    COUNT.get() - before
}

/// 20,000 rows, among them all powers of two at which the parameters are centred anew.
#[test]
fn no_memory_is_allocated_after_the_first_row() {
    let (mut monitor, rows) = watched(2_000);
    assert!(allocations(|| assert!(monitor.update(&rows[0], Some(0.0)).is_empty())) > 0);
    let mut time = 0.0;
    for row in (0..20_000).map(|k| &rows[(k + 1) % rows.len()]) {
        time += 0.0025;
        let found = allocations(|| assert!(monitor.update(row, Some(time)).is_empty()));
        assert_eq!(found, 0, "at {time:.4} s");
    }
    assert_eq!(monitor.counts().used, 20_001);
}
