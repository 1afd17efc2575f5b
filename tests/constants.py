"""What other values of constants that are only stated would do: `python -m tests.constants`.

Builds the core once with `--cfg stated`, in which `RSICALIB_STATED` says another value of a
constant. Each constant that `stated!` declares is halved, doubled and taken out (a value with which
it does nothing); the devices of `tests.ablation` are traced with each, and what comes out right is
compared, device by device, with the values as they stand. Prints a table: of how many anything is
said otherwise, how many are lost and won, with the probability of as uneven a split by chance (sign
test), and how many are explained by what they do not have. `--build FOLDER` leaves the package
there, for other commands:

    PYTHONPATH=FOLDER:. RSICALIB_STATED=degree=1 python -m tests.outside --kind outside
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy import stats

ROOT = Path(__file__).parents[1]
CORE = ROOT / "crates" / "rsicalib" / "src"
DECLARED = re.compile(r"fn (\w+)\(\) -> (f64|usize|i32) = ([\d.e-]+);")

OUT = {
    "pause": "1e9",
    "times_open": "1",
    "wrong_beside": "0",
    "more": "1",
    "amplitudes": "1",
    "room_least": "0",
    "room_share": "0",
    "largest_misclosure": "1e9",
    "largest_effect": "1e9",
    "degree": "1",
    "degree_of_two": "1",
    "law_amplitudes": "1",
    "highest_order": "1",
    "parts_of_formulas": "1",
}
"""Values with which a constant does nothing, or the least that it can."""


@dataclass(frozen=True)
class Constant:
    """A constant as it stands."""

    name: str
    file: str
    whole: bool
    value: float

    def others(self) -> tuple[str, ...]:
        """Half of it and twice as much, as text; and what takes it out."""
        out = (OUT[self.name],) if self.name in OUT else ()
        half, twice = self.value / 2, self.value * 2
        if self.whole:
            return str(int(half)), str(int(twice)), *out
        return f"{half:g}", f"{twice:g}", *out


def constants() -> Iterator[Constant]:
    """Those that the sources of the core declare."""
    for path in sorted(CORE.rglob("*.rs")):
        text = path.read_text(encoding="utf-8")
        for block in re.findall(r"^stated! \{(.*?)^\}", text, re.MULTILINE | re.DOTALL):
            for name, kind, value in DECLARED.findall(block):
                file = path.relative_to(CORE).as_posix()
                yield Constant(name, file, kind != "f64", float(value))


def build(folder: Path) -> Path:
    """The package with a core of which constants can be changed, in a folder."""
    target = ROOT / "target" / "stated"
    environment = os.environ | {"RUSTFLAGS": "--cfg stated", "CARGO_TARGET_DIR": str(target)}
    command = "cargo build --release --locked --quiet -p rsicalib-py --features".split()
    subprocess.run([*command, "pyo3/extension-module"], cwd=ROOT, env=environment, check=True)
    package = folder / "rsicalib"
    shutil.copytree(ROOT / "python" / "rsicalib", package)
    (core,) = package.glob("_core*.so")
    shutil.copyfile(target / "release" / "lib_core.so", core)
    return folder


def said(folder: Path, stated: str, asked: Sequence[str]) -> Mapping[str, Mapping[str, Any]]:
    """What is said of each device with another value of a constant."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "said.json"
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
            "RSICALIB_STATED": stated,
            "RAYON_NUM_THREADS": "1",
        }
        command = [sys.executable, "-m", "tests.ablation", "--rules", "--out", str(out), *asked]
        subprocess.run(command, cwd=ROOT, env=environment, check=True, stdout=subprocess.DEVNULL)
        (every,) = json.loads(out.read_text(encoding="utf-8")).values()
    return {one["device"]: one for one in every}


def row(constant: Constant, value: str, base: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """A line of the table."""
    both = base.keys() & other.keys()

    def says(one: Mapping[str, Any]) -> tuple[str, str]:
        return one["verdict"], one["said"]

    otherwise = sum(says(base[d]) != says(other[d]) for d in both)
    lost = sum(base[d]["right"] and not other[d]["right"] for d in both)
    won = sum(other[d]["right"] and not base[d]["right"] for d in both)
    p = stats.binomtest(lost, lost + won).pvalue if lost + won else 1.0
    misled = [sum(one[d]["misled"] for d in both) for one in (base, other)]
    return (
        f"| `{constant.name}` | {constant.value:g} | {value} | {otherwise} | {lost} | {won} "
        f"| {p:.2g} | {misled[0]} → {misled[1]} |"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.constants", description=__doc__)
    parser.add_argument("--devices", type=int, default=2, help="of every suite of every family")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", help="names of constants; else all")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--build", type=Path, help="write the package there, and measure nothing")
    options = parser.parse_args(arguments)
    if options.build:
        build(options.build)
        return 0
    asked = ["--devices", str(options.devices), "--seed", str(options.seed)]
    names = options.only or [constant.name for constant in constants()]
    cases = [(c, value) for c in constants() if c.name in names for value in c.others()]
    with tempfile.TemporaryDirectory() as scratch:
        folder = build(Path(scratch))
        with ThreadPoolExecutor(options.jobs) as pool:
            base = pool.submit(said, folder, "", asked)
            runs = [pool.submit(said, folder, f"{c.name}={value}", asked) for c, value in cases]
            right = sum(one["right"] for one in base.result().values())
            print(f"{len(base.result())} devices, {right} right\n")
            print("| constant | value | instead | said otherwise | lost | won | p | misled |")
            print("|---|---|---|---|---|---|---|---|")
            for (constant, value), run in zip(cases, runs, strict=True):
                print(row(constant, value, base.result(), run.result()), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
