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

PRIORS = ("named", "periodic", "free", "once", "bad")
KINDS = len(PRIORS) + 1
"""Kinds of candidates: what happened once are two."""
OUT = {
    "all `prior_of_…` alike": ",".join(f"prior_of_{kind}={1 / KINDS:.4f}" for kind in PRIORS),
    "`one_or_none`": "one_or_none=1",
    "`more`": "more=1",
    "`amplitudes`": "amplitudes=1",
    "`largest_effect`": "largest_effect=1e9",
    "`largest_misclosure`": "largest_misclosure=1e9",
    "`degree`": "degree=1",
    "`degree_of_two`": "degree_of_two=1",
    "`law_amplitudes`": "law_amplitudes=1",
    "`highest_order`": "highest_order=1",
    "`parts_of_formulas`": "parts_of_formulas=1",
    "`pause`": "pause=1e9",
    "`times_open`": "times_open=1",
}
"""Values with which constants do nothing, or the least that they can."""


@dataclass(frozen=True)
class Constant:
    """A constant as it stands."""

    name: str
    file: str
    whole: bool
    value: float

    def others(self) -> tuple[str, str]:
        """Half of it and twice as much, as text."""
        half, twice = self.value / 2, self.value * 2
        return (str(int(half)), str(int(twice))) if self.whole else (f"{half:g}", f"{twice:g}")


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


def cases(only: Sequence[str] | None) -> Iterator[tuple[str, str, str]]:
    """What is another: its name, as it stands, and what is said of it instead."""
    for constant in constants():
        if only is None or constant.name in only:
            for other in constant.others():
                yield f"`{constant.name}`", f"{constant.value:g}", f"{constant.name}={other}"
    for name, stated in OUT.items():
        if only is None or any(f"{one}=" in stated for one in only):
            yield name, "", stated


def row(name: str, value: str, stated: str, pair: Sequence[Mapping[str, Any]]) -> str:
    """A line of the table: a case, what is said as it is and what is said then."""
    base, other = pair
    both = base.keys() & other.keys()

    def says(one: Mapping[str, Any]) -> tuple[str, str]:
        return one["verdict"], one["said"]

    otherwise = sum(says(base[d]) != says(other[d]) for d in both)
    lost = sum(base[d]["right"] and not other[d]["right"] for d in both)
    won = sum(other[d]["right"] and not base[d]["right"] for d in both)
    p = stats.binomtest(lost, lost + won).pvalue if lost + won else 1.0
    misled = [sum(one[d]["misled"] for d in both) for one in (base, other)]
    return (
        f"| {name} | {value} | {stated} | {otherwise} | {lost} | {won} "
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
    asked_for = list(cases(options.only))
    with tempfile.TemporaryDirectory() as scratch:
        folder = build(Path(scratch))
        with ThreadPoolExecutor(options.jobs) as pool:
            base = pool.submit(said, folder, "", asked)
            runs = [pool.submit(said, folder, stated, asked) for *_, stated in asked_for]
            right = sum(one["right"] for one in base.result().values())
            print(f"{len(base.result())} devices, {right} right\n")
            print("| constant | value | instead | said otherwise | lost | won | p | misled |")
            print("|---|---|---|---|---|---|---|---|")
            for case, run in zip(asked_for, runs, strict=True):
                print(row(*case, (base.result(), run.result())), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
