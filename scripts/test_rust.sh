#!/bin/sh
# Tests of the core, clippy of everything, and the core's documentation. All have the profile of the wheel,
# whose dependencies, build scripts and macros are built already. The core as the program of its own tests
# is compiled for these alone: less is done to make it fast.
set -eu
cd "$(dirname "$0")/.."
common="--workspace --all-features --release --quiet"
cargo test $common --lib --config profile.release.package.rsicalib.opt-level=1
cargo test $common --test '*' --examples
cargo test $common --doc
cargo clippy $common --all-targets -- -D warnings
RUSTDOCFLAGS="-D warnings" cargo doc $common --no-deps
