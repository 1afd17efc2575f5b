#!/bin/sh
# Tests of the core, and its documentation. Tests have the profile of the wheel, so that both have the same
# dependencies; so has the documentation. What benches need is not built.
set -eu
cd "$(dirname "$0")/.."
RUSTC_WRAPPER="$PWD/scripts/rustc_of_tests.sh" cargo test --workspace --exclude rsicalib-benches --all-features --release --quiet
RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps --all-features --quiet
