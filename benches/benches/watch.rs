//! The watch: one row by itself, as in a control loop, against the same rows eight at a time.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use rsicalib_benches::watched;

fn main() {
    divan::main();
}

/// Rows of one timing: tests of windows of all lengths up to this are in it.
const ROWS: usize = 4_096;

#[divan::bench]
fn one_by_one(bencher: Bencher) {
    let (mut monitor, rows) = watched(ROWS);
    bencher.counter(ItemsCount::new(ROWS)).bench_local(|| {
        for row in &rows {
            assert!(monitor.update(black_box(row), None).is_empty());
        }
    });
}

/// The rival: the model is evaluated for eight rows at a time.
#[divan::bench]
#[expect(clippy::unwrap_used, reason = "a bench stops at a mistake")]
fn all_at_once(bencher: Bencher) {
    let (mut monitor, rows) = watched(ROWS);
    let values = rows.concat();
    bencher.counter(ItemsCount::new(ROWS)).bench_local(|| {
        assert!(monitor.update_all(black_box(&values), None).unwrap().is_empty());
    });
}
