#!/bin/sh
# The documentation as a site, in ./site: the pages, and the documentation of the Rust crate in site/rust.
set -eu
cd "$(dirname "$0")/.."
. scripts/setup.sh
setup docs
.venv/bin/mkdocs build --strict --quiet
RUSTDOCFLAGS="-D warnings" cargo doc --package rsicalib --no-deps --all-features --quiet
cp -r target/doc site/rust
