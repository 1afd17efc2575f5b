"""Are intervals, tests, starts and exclusions what they claim to be? Monte Carlo, seeded.

`python benches/honesty.py` from the root of the repository prints, with their standard errors
and beside what is demanded of them:

- held poses and recordings: coverage of 95 % intervals, uniformity of the lack-of-fit p-values
  (Kolmogorov-Smirnov), rms error and width of the intervals over the Cramer-Rao bound, bias of
  the gains; the same with correlated samples;
- handle error of the implicit loop beside plain least squares;
- starts: nominal gains wrong by independent factors, and the paper's own start;
- bad readings: found, falsely accused, and what they cost;
- cost: the implicit loop beside the algebraic fit, a recording of 100,000 rows.

As it is, it takes under five minutes on two cores: 1,000 sessions in each cell of held poses, 2,500
starts of each kind, a few hundred sessions of what costs more. `--full` takes four times as many of
all but the first, as the demands are written.

Devices and readings are those of `tests/blind`, which shares no code with the library. Sessions are
seeded one by one: figures depend on neither the number of processes nor their order.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
if __name__ in ("__main__", "__mp_main__"):
    # The directory of this file holds a `statistics`, which is not the one that others mean.
    sys.path[:] = [str(ROOT), *(p for p in sys.path if Path(p).resolve() != ROOT / "benches")]
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"):
        os.environ.setdefault(variable, "1")

import argparse
import json
import multiprocessing
import resource
import subprocess
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from rsicalib import _core
from rsicalib.cores import available_cores
from rsicalib.work.applying import as_applied
from tests import oracle
from tests.blind import effects, power, simulator
from tests.blind.effects import Effect
from tests.blind.scene import Scene, held, waved
from tests.blind.simulator import CHANNELS, Device, Session
from tests.oracle import Array

DATA = ROOT.parent / "shared" / "data" / "rsi"
TABLES = ROOT / "python" / "rsicalib" / "reproduction" / "tables.toml"
TREMOR = (0.01, 0.01)
RSI = _core.Mechanism.rsi()
NOMINAL = oracle.nominal(oracle.rsi())
"""Offsets and gains."""

Runner = Callable[[Callable[[int], Any], int], list[Any]]
"""Calls a job with the numbers below a count, and returns what it returned, in order."""


def inline(job: Callable[[int], Any], count: int) -> list[Any]:
    """One after the other, in this process."""
    return [job(number) for number in range(count)]


@contextmanager
def pool(jobs: int) -> Iterator[Runner]:
    """In so many processes."""
    if jobs == 1:
        yield inline
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as processes:
        yield lambda job, count: processes.map(job, range(count), chunksize=max(1, count // 200))


def table(session: Session) -> dict[str, Any]:
    """Readings as the core takes them."""
    pose = session["pose"]
    return {
        "values": session["values"].astype(np.float64),
        "pose": None if pose is None else pose.astype(np.int64),
        "time": session["time_s"],
        "temperature": None,
        "session": None,
        "keys": [],
        "used": None,
        "columns": [],
    }


def estimates(fitted: dict[str, Any], what: str = "value") -> Array:
    """Nine offsets, then nine gains, of a fit."""
    found = {(p["term"], p["target"]): p[what] for p in fitted["parameters"]}
    return np.array([found[term, name] for term in ("offset", "gain") for name in CHANNELS])


# ------------------------------------------------------------------ intervals and tests


@dataclass(frozen=True)
class Cell:
    """One kind of session; `samples` 0 for a recording, whose rows are `poses`."""

    poses: int
    samples: int
    sigma: float
    tremor: bool = False
    correlation: float = 0.0
    louder: float = 1.0
    """How many times noisier one channel is, another one in each session."""

    @property
    def name(self) -> str:
        """In words."""
        held = f"{self.poses} poses x {self.samples}, σ {self.sigma:g}"
        words = held if self.samples else f"recording of {self.poses} rows, σ {self.sigma:g}"
        words += f", one x {self.louder:g}" * (self.louder != 1.0)
        words += ", tremor" * self.tremor
        return words + (f", AR(1) {self.correlation:g}" if self.correlation else "")


@dataclass(frozen=True)
class Row:
    """One session: errors, their standard deviations and bounds, (18,), and the fit's own test."""

    error: Array
    sd: Array
    bound: Array
    p_value: float
    noise_dof: float
    apart: bool
    """Whether channels were told apart by their noise."""


def stage(cell: Cell, device: Device, rng: np.random.Generator) -> Scene:
    """Poses within reach, wherever a hand trembles."""
    while True:
        poses = simulator.hand_poses(rng, cell.poses, device)
        scene = held(rng, poses, cell.samples, TREMOR if cell.tremor else (0.0, 0.0))
        if device.allows(scene.pose).all():
            return scene


def digitised(cell: Cell, counts: Array, sigma: Array, rng: np.random.Generator) -> Array:
    """Readings with noise, the samples of a pose correlated if they are to be."""
    rho = cell.correlation
    if not rho:
        noisy = counts + sigma * rng.standard_normal(counts.shape)
        return np.clip(np.rint(noisy), 0, simulator.TOP).astype(np.int64)
    noise = rng.standard_normal((cell.poses, cell.samples, counts.shape[1]))
    for k in range(1, cell.samples):
        noise[:, k] = rho * noise[:, k - 1] + np.sqrt(1 - rho**2) * noise[:, k]
    return np.rint(counts + sigma * noise.reshape(counts.shape)).astype(np.int64)


def one_session(cell: Cell, seed: int, number: int) -> Row:
    """Simulates and fits."""
    rng = np.random.default_rng([seed, number, cell.poses, cell.samples, int(10 * cell.sigma)])
    device = Device.random(rng)
    if cell.samples:
        scene = stage(cell, device, rng)
        rows = scene.firsts()
    else:
        scene = waved(rng, device.allows, cell.poses / 200.0, 200.0)
        rows = np.arange(cell.poses)
    counts = device.ideal(scene)
    sigma = np.full(9, cell.sigma)
    sigma[number % 9] *= cell.louder
    read = {
        "values": digitised(cell, counts, sigma, rng),
        "pose": scene.label if scene.held else None,
        "time_s": scene.time_s,
    }
    rest = simulator.rest(device, rng, sigma=cell.sigma)["values"].astype(np.float64)
    fitted = _core.Session(RSI, table(read), rest=rest).fit().to_dict()
    rounded = np.sqrt(sigma**2 + power.QUANTISATION)
    least = _core.bound(RSI, counts[rows], device.offsets, device.gains, rounded)
    bound = np.r_[least["offset_sd"], least["gain_sd"]] / np.sqrt(max(cell.samples, 1))
    return Row(
        estimates(fitted) - np.r_[device.offsets, device.gains],
        estimates(fitted, "sd"),
        bound,
        fitted["fit"]["p_value"],
        fitted["noise"]["dof"] or np.inf,
        "by channel" in fitted["noise"]["source"],
    )


@dataclass(frozen=True)
class Honesty:
    """Figures of one cell. An error stands beside each: 18 parameters of a session go together."""

    sessions: int
    coverage: float
    coverage_error: float
    worst: float
    """Largest deviation of one parameter's coverage from 95 %, in its standard errors."""
    uniform: float
    rms: float
    rms_error: float
    width: float
    bias: float
    bias_error: float
    apart: float
    """Share of sessions whose noise was told channel by channel."""

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Honesty:
        """Pools sessions."""
        n = len(rows)
        error, sd, bound = (
            np.array([getattr(r, k) for r in rows]) for k in ("error", "sd", "bound")
        )
        quantile = stats.t.ppf(0.975, np.minimum([r.noise_dof for r in rows], 1e9))[:, None]
        covered = np.abs(error) <= quantile * sd
        scaled = error / bound
        gains = -scaled[:, 9:].mean(axis=1)  # gains are negative: too small counts as negative
        squares = (scaled**2).mean(axis=1)
        rms = np.sqrt(squares.mean())
        return cls(
            sessions=n,
            coverage=covered.mean(),
            coverage_error=covered.mean(axis=1).std() / np.sqrt(n),
            worst=np.abs(covered.mean(axis=0) - 0.95).max() / np.sqrt(0.95 * 0.05 / n),
            uniform=stats.kstest([r.p_value for r in rows], "uniform").pvalue,
            rms=rms,
            rms_error=squares.std() / np.sqrt(n) / (2 * rms),
            width=(quantile * sd / bound).mean() / stats.norm.ppf(0.975),
            bias=gains.mean(),
            bias_error=gains.std() / np.sqrt(n),
            apart=np.mean([r.apart for r in rows]).item(),
        )

    def line(self) -> str:
        """As printed."""
        return (
            f"cover {100 * self.coverage:5.2f} ± {100 * self.coverage_error:.2f} % "
            f"(worst parameter {self.worst:.1f} se off)  KS {self.uniform:5.3f}  "
            f"rms/bound {self.rms:.3f} ± {self.rms_error:.3f}  width/bound {self.width:.3f}  "
            f"gain bias {self.bias:+.3f} ± {self.bias_error:.3f} sd"
            + (f"  by channel {100 * self.apart:.1f} %" if self.apart else "")
        )


def honesty(cell: Cell, sessions: int, run: Runner = inline, seed: int = 0) -> Honesty:
    """Figures of one kind of session."""
    return Honesty.of(run(partial(one_session, cell, seed), sessions))


def held_cells() -> list[Cell]:
    """All that are demanded."""
    return [
        Cell(poses, samples, sigma, tremor)
        for poses in (24, 48)
        for samples in (2, 8)
        for sigma in (0.5, 1.0, 3.0)
        for tremor in (False, True)
    ]


# ------------------------------------------------------------------ against plain least squares


def load(path: Path) -> tuple[dict[str, Any], Array | None]:
    """A file of readings, and its known poses."""
    data = np.genfromtxt(path, delimiter=",", names=True)
    names = data.dtype.names or ()
    read = {
        "values": np.stack([data[c] for c in CHANNELS], axis=1),
        "pose": data["pose"] if "pose" in names else None,
        "time_s": data["time_s"].copy() if "time_s" in names else None,
    }
    known = [c for c in ("x", "y", "z", "rx", "ry", "rz") if c in names]
    return table(read), np.stack([data[c] for c in known], axis=1) if known else None


Recorded = tuple[dict[str, Any], dict[str, Any], dict[str, Any], Array]
"""Readings, the rest reading, and readings at known poses with these poses."""


def recorded(folder: Path) -> Recorded:
    """A recording in files."""
    (read, _), (rest, _) = load(folder / "readings.csv"), load(folder / "rest.csv")
    check, poses = load(folder / "check.csv")
    if poses is None:
        raise ValueError(f"{folder}: no known poses to check")
    return read, rest, check, poses


def simulated_recording(seed: int) -> Recorded:
    """A recording of 20 s of a device drawn at random."""
    rng = np.random.default_rng(seed)
    device = Device.random(rng)
    check = simulator.check(device, rng)
    sessions = simulator.recording(device, rng), simulator.rest(device, rng), check
    read, rest, known = map(table, sessions)
    return read, rest, known, check["poses"]


def handle_errors(recording: Recorded) -> dict[str, float]:
    """Position error [in] on the check poses of a recording, by method."""
    read, rest, check, poses = recording
    fit = {
        m: _core.Session(RSI, read, rest=rest["values"], method=m).fit()
        for m in ("implicit_loop", "algebraic")
    }
    return {
        m: f.check((check, poses, (0.0, 0.0), None, True))["position_rms"] for m, f in fit.items()
    }


# ------------------------------------------------------------------ starts


def paper_poses(which: str) -> Array:
    """Tables II (as corrected) and III."""
    poses = tomllib.loads(TABLES.read_text(encoding="utf-8"))["poses"]
    second, third = (np.array(poses[k], float) for k in ("fixture_printed", "closed_loop"))
    second[2, 2] = -2.666
    chosen = third if which == "III" else np.vstack([second, third])
    chosen[:, 3:] *= np.pi
    return chosen


def placed(device: Device, aim: Array, rng: np.random.Generator, sd: float = 0.25) -> Array:
    """Poses as a hand places them: (n, 6)."""
    out = aim + sd * rng.standard_normal(aim.shape)
    while not (good := device.allows(out)).all():
        out[~good] = aim[~good] + sd * rng.standard_normal(aim[~good].shape)
    return out


def believed(offsets: Array, gains: Array) -> _core.Mechanism:
    """The hand controller with these nominal sensors."""
    sensors = zip(CHANNELS, gains.tolist(), offsets.tolist(), strict=True)
    return RSI.with_sensors({name: (gain, offset) for name, gain, offset in sensors})


@dataclass(frozen=True)
class Begun:
    """One trial of a start: whether it arrived, and how many starts that took."""

    arrived: bool
    starts: int


def one_start(which: str, seed: int, number: int) -> Begun:
    """Fits with nominal gains that are wrong by independent factors, and from the truth."""
    rng = np.random.default_rng([seed, number])
    device = Device.random(rng)
    if which == "hand":
        poses = simulator.hand_poses(rng, 24, device)
    else:
        poses = placed(device, paper_poses(which), rng)
    read = table(simulator.session(device, rng, poses, samples=2))
    rest = simulator.rest(device, rng)["values"].astype(np.float64)
    gains = NOMINAL[1] * rng.uniform(0.3, 3.0, 9)
    # Nominal offsets as they were, or such that the rest pose reads mid-range.
    middle = oracle.rsi_inverse(np.array([oracle.REST])).reshape(9) - gains * 2048
    wrong = believed(middle if number % 2 else NOMINAL[0], gains)
    true = believed(device.offsets, device.gains)
    there = estimates(_core.Session(true, read, rest=rest, starts=1).fit().to_dict())
    found = _core.Session(wrong, read, rest=rest).fit().to_dict()
    arrived = np.allclose(estimates(found), there, rtol=1e-6, atol=0.0)
    return Begun(bool(arrived), len(found["starts"]))


def paper_interval(step: float = 0.002) -> tuple[float, float]:
    """Equal starting gains from which the paper's method converges on Table III [rad/count]."""
    offsets, gains = NOMINAL
    counts = (oracle.rsi_inverse(paper_poses("III")).reshape(-1, 9) - offsets) / gains

    def converges(factor: float) -> bool:
        _, found, *_ = _core.minimize(RSI, counts, offsets, gains * factor, max_iterations=200)
        return bool(np.abs(found / gains - 1).max() < 1e-3)

    ends = []
    for sign in (1, -1):
        factor = 1.0
        while converges(factor + sign * step):
            factor += sign * step
        ends.append(factor * gains[0])
    return ends[0], ends[1]


def our_interval(step: float = 0.05, reach: float = 5.0) -> tuple[float, float]:
    """The same for the fit of a session without a rest reading, nominal offsets kept.

    Looked at no farther than a factor `reach` from the truth.
    """
    offsets, gains = NOMINAL
    counts = (oracle.rsi_inverse(paper_poses("III")).reshape(-1, 9) - offsets) / gains
    read = table({"values": np.rint(counts), "pose": np.arange(12), "time_s": None})
    there = estimates(_core.Session(RSI, read).fit().to_dict())

    def converges(factor: float) -> bool:
        found = _core.Session(believed(offsets, gains * factor), read).fit().to_dict()
        return bool(np.allclose(estimates(found), there, rtol=1e-6, atol=0.0))

    ends = []
    for ratio in (1 + step, 1 / (1 + step)):
        factor = 1.0
        while 1 / reach < factor * ratio < reach and converges(factor * ratio):
            factor *= ratio
        ends.append(factor * gains[0])
    return ends[0], ends[1]


# ------------------------------------------------------------------ bad readings


@dataclass(frozen=True)
class Bad:
    """One session with bad readings, and the same without them."""

    wanted: int
    pose: int
    """Of which the pose (and sample) was excluded."""
    arm: int
    """And the arm, or its channel, was named, and rightly."""
    open: int
    """Where the arm was left open."""
    extras: int
    with_them: float
    without: float
    """Handle position error on check poses."""


def spoilt(
    kind: type[Effect], count: int, device: Device, scene: Scene, rng: np.random.Generator
) -> tuple[Effect, ...]:
    """Bad readings at different poses, each of noncentrality 40 to 4000 beside the others."""
    out: list[Effect] = []
    while len(out) < count:
        drawn = kind.draw(rng)
        wanted = float(np.exp(rng.uniform(np.log(40.0), np.log(4000.0))))
        # At the first and the last pose a bad reading is a slip between two poses, exactly.
        if getattr(drawn, "pose", 1) in (1, 48, *(getattr(e, "pose", 1) for e in out)):
            continue
        session = {"scene": scene, "sigma": 1.0}
        scaled = power.scaled_to(device, session, drawn, wanted, out)
        if abs(scaled.size) > 1000.0:
            continue  # nobody would call that a reading
        if power.noncentrality(device, session, scaled, out) >= 0.99 * wanted:
            out.append(scaled)
    return tuple(out)


def at_pose(effect: Effect, excluded: dict[str, Any]) -> bool:
    """Whether an exclusion names the pose of a bad reading, and its sample if it is one."""
    place = (getattr(effect, "pose", None), getattr(effect, "sample", None))
    return place == (excluded["pose"], excluded["sample"])


def names_arm(effect: Effect, excluded: dict[str, Any]) -> bool | None:
    """Whether it names the right arm, or the channel; None where it names none."""
    if excluded["channel"] is not None:
        return bool(excluded["channel"][1] == effect.target[1])
    if excluded["chain"] is not None:
        return bool(excluded["chain"] == f"arm{effect.target[1]}")
    return None


def one_bad(kind: type[Effect] | None, count: int, seed: int, number: int) -> Bad:
    """Traces a session of 48 poses x 8 with `count` bad readings."""
    rng = np.random.default_rng([seed, number, count])
    device = Device.random(rng)
    scene = held(rng, simulator.hand_poses(rng, 48, device), 8, (0.0, 0.0))
    wrong = spoilt(kind, count, device, scene, rng) if kind else ()
    state = rng.bit_generator.state
    sessions = []
    for effect in (wrong, ()) if wrong else ((),):
        rng.bit_generator.state = state  # the same noise
        sessions.append(simulator.observe(device, scene, rng, 1.0, effect))
    rest = simulator.rest(device, rng)["values"].astype(np.float64)
    other = simulator.check(device, rng)
    known = (table(other), other["poses"], (0.0, 0.0), None, True)
    beside = {"mechanism": RSI, "declared": as_applied(None, RSI), "known": known, "align": False}
    beside |= {"whole": None, "groups": None, "keep": None, "leave": None, "own": True}
    result = _core.Session(RSI, table(sessions[0]), rest=rest).trace(beside)
    clean = _core.Session(RSI, table(sessions[-1]), rest=rest).fit().check(known)
    out = result["excluded"]
    hits = [(effect, e) for effect in wrong for e in out if at_pose(effect, e)]
    arms = [names_arm(effect, e) for effect, e in hits]
    return Bad(
        len(wrong),
        len(hits),
        arms.count(True),
        arms.count(None),
        len(out) + len(result["steps"]) - len(hits),
        result["after"]["check"]["position_rms"],
        clean["position_rms"],
    )


def bad_line(rows: Sequence[Bad]) -> str:
    """As printed."""
    wanted = sum(r.wanted for r in rows)
    more = np.array([r.extras > 0 for r in rows])
    line = f"anything else named in {100 * more.mean():.1f} % of {len(rows)} sessions"
    if not wanted:
        return line

    def share(count: int) -> str:
        return f"{100 * count / wanted:.1f} %"

    arm, left, pose = (sum(getattr(r, k) for r in rows) for k in ("arm", "open", "pose"))
    return (
        f"pose found {share(pose)} of {wanted}; arm right {share(arm)}, left open {share(left)}, "
        f"wrong {share(pose - arm - left)}; {line}; handle error {error_ratio(rows):.3f} times "
        "that of the session without them"
    )


def error_ratio(rows: Sequence[Bad]) -> float:
    """Handle error with what was found of the bad readings over that without them, rms."""
    squares = np.array([(r.with_them**2, r.without**2) for r in rows]).sum(axis=0)
    return float(np.sqrt(squares[0] / squares[1]))


# ------------------------------------------------------------------ cost


def best(call: Callable[[], object], seconds: float) -> float:
    """Shortest of as many calls as fit into the time [s]."""
    times: list[float] = []
    end = time.perf_counter() + seconds
    while not times or time.perf_counter() < end:
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def fit_times(poses: int = 24, seconds: float = 1.0) -> dict[str, float]:
    """Time of a fit of so many poses, one sample each, start included, by method [s]."""
    rng = np.random.default_rng(24)
    device = Device.random(rng)
    read = table(simulator.session(device, rng, simulator.hand_poses(rng, poses, device), 1))
    rest = simulator.rest(device, rng)["values"].astype(np.float64)
    made = {
        m: _core.Session(RSI, read, rest=rest, method=m) for m in ("implicit_loop", "algebraic")
    }
    return {m: best(session.fit, seconds) for m, session in made.items()}


def long_recording(rows: int) -> dict[str, float]:
    """Seconds, and peak memory over that of the readings [MB], of one fit; in a fresh process."""
    rng = np.random.default_rng(100_000)
    device = Device.random(rng)
    session = simulator.recording(device, rng, seconds=rows / 200.0)
    rest = simulator.rest(device, rng)["values"].astype(np.float64)
    read = table(session)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    _core.Session(RSI, read, rest=rest).fit()
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"seconds": seconds, "more_mb": (after - before) / 1024, "peak_mb": after / 1024}


def long_recording_elsewhere(rows: int, threads: int) -> dict[str, float]:
    """The same in a process of its own."""
    environment = os.environ | {"RAYON_NUM_THREADS": str(threads)}
    command = [sys.executable, str(Path(__file__).resolve()), "--recording", str(rows)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


# ------------------------------------------------------------------ the command


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="a tenth of the sessions")
    size.add_argument("--full", action="store_true", help="10,000 starts and more of the costly")
    parser.add_argument("--jobs", type=int, default=available_cores())
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=["held", "recordings", "starts", "bad", "cost"])
    parser.add_argument("--recording", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.recording:
        print(json.dumps(long_recording(options.recording)))
        return
    scale = 0.1 if options.quick else 4.0 if options.full else 1.0
    began = time.perf_counter()
    sections = {
        "held": print_held,
        "recordings": print_recordings,
        "starts": print_starts,
        "bad": print_bad,
        "cost": print_cost,
    }
    with pool(options.jobs) as run:
        for name, section in sections.items():
            if options.only in (None, name):
                section(run, scale, options.seed)
                print(f"   [{time.perf_counter() - began:.0f} s]", flush=True)


def print_cells(cells: Sequence[Cell], sessions: int, run: Runner, seed: int) -> None:
    """A line for each."""
    for cell in cells:
        print(f"{cell.name:38s} {honesty(cell, sessions, run, seed).line()}", flush=True)


def print_held(run: Runner, scale: float, seed: int) -> None:
    """Held poses."""
    sessions = int(1000 * min(scale, 1.0))  # what is demanded
    print(
        f"== Held poses, {sessions} sessions each. Demanded: cover 94-96 %, every parameter within"
    )
    print("   3 se; KS > 0.01; rms/bound and width/bound 0.97-1.05; gain bias below 0.1 sd")
    print_cells(held_cells(), sessions, run, seed)
    print("== Correlated samples. Demanded: cover > 93 %; the bound is that of independent ones")
    cells = [Cell(p, n, 1.0, correlation=0.6) for p in (24, 48) for n in (8, 4)]
    print_cells(cells, sessions, run, seed)
    print("   of two samples correlation cannot be seen; that the model does not fit can (KS):")
    print_cells([Cell(48, 2, 1.0, correlation=0.6)], sessions // 2, run, seed)
    print("== One channel noisier; readings so quiet that rounding lasts. Demanded: 94-96 %")
    cells = [Cell(p, n, 1.0, louder=4.0) for p, n in ((24, 2), (48, 2), (24, 8))]
    print_cells([*cells, Cell(24, 8, 0.1), Cell(24, 8, 0.0)], sessions // 2, run, seed)


def print_recordings(run: Runner, scale: float, seed: int) -> None:
    """Recordings, and plain least squares."""
    sessions = int(250 * scale)
    print(f"== Recordings, {sessions} each. Demanded: as for held poses")
    print_cells([Cell(4000, 0, sigma) for sigma in (0.5, 1.0, 3.0)], sessions, run, seed)
    if (DATA / "waved").is_dir():
        error = handle_errors(recorded(DATA / "waved"))
        loop, plain = error["implicit_loop"], error["algebraic"]
        print(f"waved: handle error {loop:.5f} in, plain least squares {plain:.5f} in")


def print_starts(run: Runner, scale: float, seed: int) -> None:
    """Starts."""
    trials = int(2_500 * scale)
    print("== Starts, nominal gains times factors from [0.3, 3]. Demanded: ≥ 99.9 % arrive")
    for which, words in (
        ("hand", "24 hand-held poses"),
        ("III", "Table III"),
        ("both", "II + III"),
    ):
        rows = run(partial(one_start, which, seed), trials)
        failed = sum(not r.arrived for r in rows)
        starts = np.array([r.starts for r in rows])
        print(
            f"{words:20s} {100 * (1 - failed / trials):.2f} % ({failed} of {trials} fail); starts: "
            f"mean {starts.mean():.2f}, 99 % within {np.percentile(starts, 99):.0f}, "
            f"most {starts.max()}",
            flush=True,
        )
    low, high = (1e3 * k for k in paper_interval())
    print(f"equal gains, the paper's method: [{low:.2f}, {high:.2f}]e-3; paper [-1.54, -1.33]e-3")
    low, high = (1e3 * k for k in our_interval())
    print(f"equal gains, ours, no rest reading: [{low:.2f}, {high:.2f}]e-3, looked at to 5 times")


def print_bad(run: Runner, scale: float, seed: int) -> None:
    """Bad readings."""
    print("== Bad readings of noncentrality 40 and more. Demanded: found with pose and arm ≥ 98 %,")
    print("   clean sessions accused ≤ 1 %, error within 5 % of the session without them")
    cases: list[tuple[str, type[Effect] | None, int, int]] = [
        ("clean", None, 0, 250),
        ("one reading", effects.BadReading, 1, 150),
        ("three readings", effects.BadReading, 3, 80),
        ("one sample", effects.GrossSample, 1, 100),
    ]
    for words, kind, count, sessions in cases:
        rows = run(partial(one_bad, kind, count, seed), int(sessions * scale))
        print(f"{words:16s} {bad_line(rows)}", flush=True)


def print_cost(run: Runner, scale: float, seed: int) -> None:
    """Cost."""
    print("== Cost. Demanded: at most 4 times the algebraic fit; 100,000 rows in 2 s on two cores")
    took = fit_times()
    loop, plain = took["implicit_loop"], took["algebraic"]
    print(
        f"24 poses: implicit loop {1e6 * loop:.0f} µs, algebraic {1e6 * plain:.0f} µs, "
        f"{loop / plain:.2f} times"
    )
    for threads in (1, 2):
        found = long_recording_elsewhere(100_000, threads)
        print(
            f"100,000 rows, {threads} thread{'s' * (threads > 1)}: {found['seconds']:.2f} s, "
            f"{found['more_mb']:.0f} MB beside the readings, {found['peak_mb']:.0f} MB in all"
        )


if __name__ == "__main__":
    main()
