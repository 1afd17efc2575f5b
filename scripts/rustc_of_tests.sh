#!/bin/sh
# The compiler, as scripts/test_rust.sh has it called. Unit tests of the core are compiled in two units that do not
# look into each other: 132 s of processor time for 180, and they run 10 to 15 s longer. All else is compiled as for the wheel.
case " $* " in
*" --crate-name rsicalib "*" --test "*) exec "$@" -C lto=off -C codegen-units=2 ;;
*) exec "$@" ;;
esac
