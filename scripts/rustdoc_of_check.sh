#!/bin/sh
# rustdoc, as ./check has cargo call it for the examples in the documentation: the pages come first, from the same crates, and
# a warning of theirs is an error. `cargo doc` would check each dependency once more.
set -eu

# pages ARGUMENTS...: without those that say how examples are run.
pages() {
    after=""
    for argument; do
        shift
        case "$after $argument" in
        *" --test" | *" --test-run-directory" | "--test-run-directory "*) ;;
        *) set -- "$@" "$argument" ;;
        esac
        after=$argument
    done
    rustdoc "$@" -D warnings --out-dir "${CARGO_TARGET_DIR:-target}/doc_of_check"
}

case " $* " in
*" --test "*) pages "$@" ;;
esac
exec rustdoc "$@"
