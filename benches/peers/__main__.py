"""The paper's problem (11) by rsicalib and by its rivals: `python benches/peers`.

Each rival is a program that gets the same counts and the same start, and is stopped by the same
tolerance: a last step below 1e-8 of the parameters. Costs are computed here, by one function, and
all minima must agree before anything is timed. The programs then run in turn, many short rounds
each on one thread; a figure is the shortest fit of all rounds, and what counts is the ratio within
one run. A rival that cannot be built here is left out, with the reason. `--write` puts the table
into BENCHMARK.md; `--beside NAME=FOLDER` adds another build of the package, for before and after.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

if __name__ == "__main__":
    sys.path[0] = str(ROOT)

import numpy as np

from benches.speed import Rival, session

CXX = ["-std=c++17", "-O3", "-march=native", "-ffast-math"]
PROGRAMS = {
    "ceres::TinySolver": ("tiny_solver.cpp", ["-I/usr/include/eigen3"]),
    "ceres::Solver": ("ceres.cpp", ["-I/usr/include/eigen3", "-lceres", "-lglog"]),
    "cminpack": ("cminpack.cpp", ["-lcminpack"]),
}
AGREES = 1e-3
"""Largest distance of a minimum from the common one, in standard deviations of the parameters."""


@dataclass
class Peer:
    """A program, and what it was measured to do."""

    name: str
    command: list[str]
    environment: dict[str, str] = field(default_factory=dict)
    seconds: dict[int, float] = field(default_factory=dict)
    linearizations: dict[int, int] = field(default_factory=dict)
    off: dict[int, float] = field(default_factory=dict)
    """Distance of the minimum from the common one, in standard deviations."""

    def start(self, problem: str) -> subprocess.Popen[str]:
        """The program, with the problem given."""
        one = {f"{v}_NUM_THREADS": "1" for v in ("OMP", "OPENBLAS", "MKL", "RAYON")}
        process = subprocess.Popen(
            self.command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **one, **self.environment},
            cwd=ROOT,
        )
        assert process.stdin is not None
        process.stdin.write(problem)
        process.stdin.flush()
        return process

    def ask(self, process: subprocess.Popen[str], seconds: float) -> tuple[float, int, np.ndarray]:
        """Shortest fit of one round [s], linearisations, and x."""
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(f"{seconds}\n")
        process.stdin.flush()
        words = process.stdout.readline().split()
        if len(words) != 20:
            raise SystemExit(
                f"error: {self.name} gave {words}, expected a time, a count and 18 numbers"
            )
        return float(words[0]), int(words[1]), np.array(words[2:], dtype=float)


def peers(folder: Path, beside: list[str]) -> tuple[list[Peer], list[str]]:
    """The programs that can be built here, rsicalib first; and why others cannot."""
    worker = [sys.executable, str(HERE / "worker.py")]
    found = [Peer("rsicalib", [*worker, "rsicalib"], {"PYTHONPATH": str(ROOT)})]
    for named in beside:
        name, _, place = named.partition("=")
        path = f"{Path(place).resolve()}{os.pathsep}{ROOT}"
        found.append(Peer(name, [*worker, "rsicalib"], {"PYTHONPATH": path}))
    missing = []
    for name, (source, flags) in PROGRAMS.items():
        program = folder / Path(source).stem
        reason = build(["c++", *CXX, str(HERE / source), "-o", str(program), *flags])
        if reason:
            missing.append(f"{name}: {reason}")
        else:
            found.append(Peer(name, [str(program)]))
    cargo = ["cargo", "build", "--release", "--quiet", "-p", "rsicalib-benches"]
    reason = build([*cargo, "--example", "levenberg_marquardt"])
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    if reason:
        missing.append(f"levenberg-marquardt: {reason}")
    else:
        program = target / "release" / "examples" / "levenberg_marquardt"
        found.append(Peer("levenberg-marquardt", [str(program)]))
    found.append(Peer("SciPy", [*worker, "scipy"], {"PYTHONPATH": str(ROOT)}))
    return found, missing


def build(command: list[str]) -> str:
    """Runs a compiler; the reason where it fails."""
    if shutil.which(command[0]) is None:
        return f"no {command[0]}"
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    errors = [line for line in done.stderr.splitlines() if "error" in line or "cannot find" in line]
    return "" if done.returncode == 0 else (errors or [f"{command[0]} failed"])[0].strip()


def compare(poses: int, everyone: list[Peer], seconds: float, rounds: int) -> None:
    """Checks that all minima agree, then times everyone in turn."""
    counts, start = session(poses)
    problem = " ".join(map(repr, [poses, *start.tolist(), *counts.ravel().tolist()])) + "\n"
    running = [(peer, peer.start(problem)) for peer in everyone]
    try:
        found = {peer.name: peer.ask(process, 0.0) for peer, process in running}
        judge = Rival(counts)
        cost = {name: 0.5 * float(np.sum(judge.fun(x) ** 2)) for name, (_, _, x) in found.items()}
        best = found[min(cost, key=lambda name: cost[name])][2]
        jacobian = judge.jac(best)
        size = np.linalg.norm(jacobian, axis=0)
        inverse = np.linalg.inv((jacobian / size).T @ (jacobian / size))
        free = max(len(jacobian) - 18, 1)
        sd = np.sqrt(np.diag(inverse) * 2 * min(cost.values()) / free) / size
        for peer in everyone:
            _, peer.linearizations[poses], x = found[peer.name]
            peer.off[poses] = float(np.max(np.abs(x - best) / sd))
            if peer.off[poses] > AGREES:
                raise SystemExit(
                    f"error: {peer.name} stops {peer.off[poses]:.1e} standard deviations from "
                    f"the common minimum of {poses} poses (cost {cost[peer.name]!r}), expected "
                    f"at most {AGREES}"
                )
        for _ in range(rounds):
            for peer, process in running:
                best_time = peer.ask(process, seconds)[0]
                peer.seconds[poses] = min(peer.seconds.get(poses, np.inf), best_time)
    finally:
        for _, process in running:
            process.terminate()


def table(everyone: list[Peer], missing: list[str], sizes: list[int]) -> str:
    """The ratios, as Markdown."""
    us = everyone[0]
    lines = [
        f"| fit | {' | '.join(f'{n:,} poses' for n in sizes)} |",
        "|---" * (len(sizes) + 1) + "|",
    ]
    for peer in everyone:
        cells = []
        for n in sizes:
            ratio = peer.seconds[n] / us.seconds[n]
            own = f"{peer.seconds[n] * 1e6:.1f} µs" if peer is us else f"{ratio:.2f}"
            cells.append(f"{own} ({peer.linearizations[n]})")
        lines.append(f"| {peer.name} | {' | '.join(cells)} |")
    worst = max(max(peer.off.values()) for peer in everyone)
    lines += [
        "",
        "First line: a whole fit from arrays to arrays; below: times as long in the same run,",
        "and in brackets the number of Jacobians. One thread. All minima agree to",
        f"{worst:.0e} standard deviations of the parameters.",
    ]
    lines += [f"Not built here: {reason}." for reason in missing]
    return "\n".join(lines)


def machine() -> str:
    """The processor, in words."""
    names = (
        [
            line.partition(":")[2].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ]
        if Path("/proc/cpuinfo").exists()
        else []
    )
    return f"{(names or [platform.processor()])[0]}, {os.cpu_count()} cores, {platform.system()}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--poses", type=int, nargs="*", default=[12, 24, 200, 2000])
    parser.add_argument("--seconds", type=float, default=0.1, help="of one round")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--beside", action="append", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--write", action="store_true", help="into BENCHMARK.md")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        everyone, missing = peers(Path(folder), options.beside)
        for poses in options.poses:
            compare(poses, everyone, options.seconds, options.rounds)
    made = table(everyone, missing, options.poses)
    print(made)
    if options.write:
        put("peers", f"{machine()}.\n\n{made}")


def put(section: str, text: str) -> None:
    """Replaces what stands between the marks of a section of BENCHMARK.md."""
    file = ROOT / "BENCHMARK.md"
    begin, end = f"<!-- {section} -->", f"<!-- end of {section} -->"
    before, _, rest = file.read_text(encoding="utf-8").partition(begin)
    _, _, after = rest.partition(end)
    file.write_text(f"{before}{begin}\n{text}\n{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
