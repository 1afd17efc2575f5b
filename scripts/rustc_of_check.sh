#!/bin/sh
# The compiler, as ./check has cargo call it. A crate of the workspace is read by clippy first, with the arguments of its
# compiler: all that it depends on is compiled, where `cargo clippy` would check each dependency once more (docs/decisions/0011).
#
# Unit tests of the core are compiled without what costs more to compile than it saves to run: in eight units, without
# optimisation across them, without vectors. Programs of tests beside it are not optimised. All else is compiled as for the
# wheel: `cargo bench` takes the benches that are compiled here.
set -eu

# clippy RUSTC ARGUMENTS...: a warning is an error. Nothing is kept.
clippy() {
    kept=$(mktemp -d)
    out=""
    for argument; do
        shift
        case "$out$argument" in
        --emit=*) argument=--emit=metadata ;;
        --out-dir*) [ -z "$out" ] || argument=$kept ;;
        esac
        if [ "$argument" = --out-dir ]; then out=--out-dir; else out=""; fi
        set -- "$@" "$argument"
    done
    failed=0
    clippy-driver "$@" -D warnings >&2 || failed=$?
    rm -r "$kept"
    return $failed
}

# Clippy reads the core as the program of its unit tests, which has all of it.
case "${CARGO_PRIMARY_PACKAGE:+own} $* " in
"own "*" --crate-name rsicalib "*" --crate-type lib "*) set -- "$@" -D warnings ;;
"own "*) clippy "$@" ;;
esac

case " $* " in
*" --crate-name rsicalib "*" --test "*)
    exec "$@" -C opt-level=2 -C lto=off -C codegen-units=8 -C no-vectorize-loops -C no-vectorize-slp
    ;;
*" --crate-name suite "* | *" --crate-name fuzz "*) exec "$@" -C opt-level=0 ;;
*) exec "$@" ;;
esac
