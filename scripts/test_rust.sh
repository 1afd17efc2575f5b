#!/bin/sh
# Tests of the core, its documentation, and what clippy says of every crate but the bindings, which `build` compiles.
# Dependencies have the profile of the wheel and, with the whole workspace, its features: all have the same. Benches are
# compiled and read, not run.
set -eu
cd "$(dirname "$0")/.."
export RUSTC_WORKSPACE_WRAPPER="$PWD/scripts/rustc_of_check.sh" RUSTDOC="$PWD/scripts/rustdoc_of_check.sh"
cargo test --workspace --all-features --release --quiet
cargo build --workspace --all-features --release --quiet --bench '*'
