# Sourced by ./demo and ./check, from the top of the checkout: a virtual environment in .venv
# (an existing one is used as it is) with the package built into it. Touches nothing else.

die() {
    echo "$*" >&2
    exit 1
}

find_python() {
    for python in ${PYTHON:-} python3 python3.14 python3.13 python3.12 python3.11; do
        if "$python" -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            return
        fi
    done
    die "no Python of 3.11 or later with the module venv; set PYTHON to one"
}

pip_install() {
    .venv/bin/python -m pip --disable-pip-version-check install --quiet --no-compile "$@"
}

# fetch FILE: what the file asks for. Pip takes 40 s of processor time for what the tests need, uv 2; where uv has
# no wheel, or does not reach the index that pip is set up for, pip does it.
fetch() {
    if pip_install --only-binary uv uv 2>/dev/null &&
        VIRTUAL_ENV="$PWD/.venv" .venv/bin/uv pip install --quiet -r "$1" 2>/dev/null; then
        return
    fi
    pip_install -r "$1"
}

build() {
    PIP_QUIET=1 VIRTUAL_ENV="$PWD/.venv" .venv/bin/maturin develop --release --quiet "$@" >&2
}

# find_cargo: a cargo that is not older than Cargo.toml asks for.
find_cargo() {
    command -v cargo >/dev/null || die "no cargo; see https://rustup.rs"
    needed=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' Cargo.toml)
    there=$(cargo --version | cut -d ' ' -f 2)
    oldest=$(printf '%s\n' "$needed" "$there" | sort -V | head -n 1)
    [ "$oldest" = "$needed" ] || die "cargo is of $there, and $needed or later is needed; see https://rustup.rs"
}

# environment: the interpreter in .venv, with nothing in it. What a program imports it compiles once, into .venv, whatever
# is set up elsewhere: programs of the tests would compile it each time.
environment() {
    unset PYTHONDONTWRITEBYTECODE
    export PYTHONPYCACHEPREFIX="$PWD/.venv/bytecode"
    find_cargo
    if [ ! -x .venv/bin/python ]; then
        find_python
        "$python" -m venv .venv
    fi
}

# builder: the tool that builds the package.
builder() {
    pip_install "maturin>=1.9,<2"
}

# packages [EXTRAS]: what these extras of pyproject.toml ask for, separated by commas.
packages() {
    .venv/bin/python scripts/requirements.py "${1:-}" >.venv/requirements.txt
    fetch .venv/requirements.txt
}

# setup [EXTRAS]: the package, and what these extras ask for.
setup() {
    environment
    builder
    # What Python needs is fetched while the core compiles.
    packages "${1:-}" &
    fetched=$!
    build --skip-install
    wait "$fetched"
    build
}
