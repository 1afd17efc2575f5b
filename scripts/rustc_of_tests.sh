#!/bin/sh
# The compiler, as scripts/test_rust.sh has it called. Unit tests of the core are little optimised, in eight units and
# without optimisation across them: 87 s of processor time to compile and to run them for 125 (docs/decisions/0011). All
# else is compiled as for the wheel.
case " $* " in
*" --crate-name rsicalib "*" --test "*) exec "$@" -C opt-level=1 -C lto=off -C codegen-units=8 ;;
*) exec "$@" ;;
esac
