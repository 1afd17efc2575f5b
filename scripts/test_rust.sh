#!/bin/sh
# Tests of the core, and its documentation; with --no-run they are compiled only. Tests have the profile of the wheel,
# whose dependencies are built already; the documentation has that of clippy, which has read them. What benches need is
# not built.
set -eu
cd "$(dirname "$0")/.."
RUSTC_WRAPPER="$PWD/scripts/rustc_of_tests.sh" cargo test --workspace --exclude rsicalib-benches --all-features --release --quiet "$@"
[ $# -gt 0 ] || RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --all-features --quiet
