#!/bin/sh
# The compiler of the crates of the workspace, as ./check has cargo call it: what a plain cargo compiled is not taken for it.
# Clippy reads each crate first, with the arguments of its compiler: all that it depends on is compiled, where `cargo clippy`
# would check each dependency once more (docs/decisions/0011).
#
# Unit tests of the core are compiled without what costs more to compile than it saves to run: in eight units, without
# optimisation across them, without vectors, and for this processor alone: hot loops are compiled once and not for each width,
# which programs of tests beside the core and Python's tests try. The bindings, which hand values over, and programs of tests
# beside the core are not optimised, nor benches, which are not run. All else is compiled as for the wheel.
set -eu

# clippy RUSTC ARGUMENTS...: a warning is an error. Nothing is kept.
clippy() {
    kept=$(mktemp -d)
    out=""
    for argument; do
        shift
        case "$out$argument" in
        --emit=*) argument=--emit=metadata ;;
        --json=*) argument=--json=diagnostic-rendered-ansi ;; # cargo hears of no file that is not kept
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

# Clippy reads the core as the program of its unit tests, which has all of it. What asks for the version has no crate.
case " $* " in
*" --crate-name rsicalib "*" --crate-type lib "*) set -- "$@" -D warnings ;;
*" --crate-name ___ "*) ;;
*" --crate-name "*) clippy "$@" ;;
esac

case " $* " in
*" --crate-name rsicalib "*" --test "*)
    exec "$@" -C opt-level=2 -C lto=off -C codegen-units=8 -C no-vectorize-loops -C no-vectorize-slp -C target-cpu=native
    ;;
*" --crate-name _core "*) exec "$@" -C opt-level=0 -C debug-assertions=off ;;
*" --crate-name suite "* | *" --crate-name fuzz "* | *rsicalib_benches*) exec "$@" -C opt-level=0 ;;
*) exec "$@" ;;
esac
