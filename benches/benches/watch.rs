//! The watch: one row by itself, as in a control loop, against the same rows eight at a time.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use rsicalib_benches::watched;

fn main() {
    divan::main();
}

/// Rows of one timing: tests of windows of all lengths up to this are in it. A watch sees each row
/// once, as noise that comes again is a change.
const ROWS: usize = 4_096;

#[divan::bench]
fn one_by_one(bencher: Bencher) {
    let bencher = bencher.counter(ItemsCount::new(ROWS)).with_inputs(|| watched(ROWS));
    bencher.bench_local_refs(|(monitor, rows)| {
        for row in rows.iter() {
            assert!(monitor.update(black_box(row), None).is_empty());
        }
    });
}

/// The rival: the model is evaluated for eight rows at a time.
#[divan::bench]
#[expect(clippy::unwrap_used, reason = "a bench stops at a mistake")]
fn all_at_once(bencher: Bencher) {
    let inputs = || {
        let (monitor, rows) = watched(ROWS);
        (monitor, rows.concat())
    };
    let bencher = bencher.counter(ItemsCount::new(ROWS)).with_inputs(inputs);
    bencher.bench_local_refs(|(monitor, values)| {
        assert!(monitor.update_all(black_box(&*values), None).unwrap().is_empty());
    });
}
