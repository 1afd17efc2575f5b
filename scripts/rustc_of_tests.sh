#!/bin/sh
# The compiler, as scripts/test_rust.sh has it called. Unit tests of the core are compiled without what costs more to compile
# than it saves to run: in eight units, without optimisation across them, without vectors. 81 s of processor time to compile
# and to run them (docs/decisions/0011). Programs of tests beside it are not optimised: 9 s less. All else is compiled as for the wheel.
case " $* " in
*" --crate-name rsicalib "*" --test "*)
    exec "$@" -C opt-level=2 -C lto=off -C codegen-units=8 -C no-vectorize-loops -C no-vectorize-slp
    ;;
*" --crate-name suite "* | *" --crate-name fuzz "*) exec "$@" -C opt-level=0 ;;
*) exec "$@" ;;
esac
