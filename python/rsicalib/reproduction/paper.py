"""The paper's tables, computed again beside the printed ones.

J. M. Hollerbach and D. M. Lokhorst, "Closed-Loop Kinematic Calibration of the RSI 6-DOF Hand
Controller". The printed numbers come with the package (`reproduction/tables.toml`). No raw readings
were published: what rests on them is simulated on a device with parameter set I.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.devices import Device, nominal_device
from rsicalib.errors import InputError
from rsicalib.measures import SCALINGS
from rsicalib.records import Record
from rsicalib.reproduction.convergence import (
    Estimate,
    NoiseCell,
    Progress,
    closed_loop_noise,
    convergence_equal,
    convergence_independent,
    fixture_lines,
    open_loop_noise,
    placed,
    run,
    start_success,
)
from rsicalib.reproduction.misprints import Misprint, Printed, misprints

__all__ = ["Cell", "Paper", "Row", "Table", "paper", "printed_numbers"]

POSE = ("x", "y", "z", "θx", "θy", "θz")
JOINTS = tuple(f"{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
CHANNELS = tuple(f"a{ij}" for ij in JOINTS)
NOISE = 1.0
"""Counts of noise assumed where section IV is simulated; Table IX starts there."""


@dataclass(frozen=True)
class Cell(Record):
    """One figure of a table.

    Attributes
    ----------
    computed : float or None
        By us; None where the paper gives nothing to compute it from.
    printed : float or None
        In the paper, misprints corrected; None where it has no such figure.
    sd : float or None
        Standard error of `computed`, where it is a mean over trials.
    """

    computed: float | None = None
    printed: float | None = None
    sd: float | None = None


@dataclass(frozen=True)
class Row(Record):
    """A line of a table."""

    label: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Table(Record):
    """A table of the paper, or a set of figures from its text.

    Attributes
    ----------
    id : str
        `I` to `IX`, `convergence`, `calibrations`, `bound`.
    title : str
        What it shows.
    columns : tuple of str
        Heads of the cells, with units.
    rows : tuple of Row
        The figures.
    verdict : str
        `reproduced`, `partly reproduced`, `order only`, `simulated`, `as printed` or `ours`.
    notes : tuple of str
        What differs, and why.
    """

    id: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    verdict: str
    notes: tuple[str, ...] = ()

    def __getitem__(self, label: str) -> Row:
        """The row of a label."""
        for row in self.rows:
            if row.label == label:
                return row
        raise KeyError(f"no row {label!r} in Table {self.id}; there are {self._labels()}")

    def _labels(self) -> str:
        return ", ".join(row.label for row in self.rows)

    def text(self) -> str:
        """The table for people: computed figures, printed ones in parentheses."""
        head = ["", *self.columns]
        body = [[row.label, *(_figure(cell) for cell in row.cells)] for row in self.rows]
        body = [line + [""] * (len(head) - len(line)) for line in body]
        widths = [max(len(line[k]) for line in [head, *body]) for k in range(len(head))]
        name = f"Table {self.id}" if self.id.isupper() else self.id.capitalize()
        out = [f"{name}: {self.title} [{self.verdict}]"]
        for line in [head, *body]:
            first = line[0].ljust(widths[0])
            rest = (cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True))
            out.append("  ".join([first, *rest]).rstrip())
        out += [f"- {note}" for note in self.notes]
        return "\n".join(out) + "\n"


@dataclass(frozen=True)
class Paper(Record):
    """Everything that the paper prints, computed again.

    Attributes
    ----------
    format, version : str
        Of the JSON, and of rsicalib.
    trials, seed : int
        Of the simulations.
    tables : tuple of Table
        In the paper's order, then convergence, calibrations and the bound.
    misprints : tuple of Misprint
        Each settled by a calculation.
    """

    format: str
    version: str
    trials: int
    seed: int
    tables: tuple[Table, ...]
    misprints: tuple[Misprint, ...]

    def __getitem__(self, table: str) -> Table:
        """A table by its id."""
        for one in self.tables:
            if one.id == table:
                return one
        raise KeyError(f"no table {table!r}; there are {', '.join(t.id for t in self.tables)}")

    def text(self) -> str:
        """Every table and every misprint for people."""
        out = [
            "The tables of Hollerbach and Lokhorst, computed again.",
            "Computed figures ± standard error (printed figures); inches and radians.",
            f"{self.trials} trials in a simulated cell, seed {self.seed}.",
            "",
        ]
        out += [table.text() for table in self.tables]
        out.append("Misprints and gaps, each settled by a calculation:")
        for m in self.misprints:
            out += ["", f"{m.where}: {m.printed}  ->  {m.right}", f"  {m.why}"]
        return "\n".join(out) + "\n"


def paper(
    trials: int = 1000,
    *,
    seed: int = 1995,
    progress: Callable[[str, int, int], None] | None = None,
    workers: int | None = None,
) -> Paper:
    """Compute every table of the paper again.

    Parameters
    ----------
    trials : int
        In every simulated cell; standard errors shrink with its root.
    seed : int
        Same seed, same figures, on any number of cores.
    progress : callable, optional
        Called with what is being computed, trials done, and trials in all.
    workers : int, optional
        Threads; as many as there are cores by default.

    Returns
    -------
    Paper
        Tables and misprints, each figure beside the printed one.

    Raises
    ------
    InputError
        There are not enough trials.
    """
    if trials < 2:
        raise InputError(f"trials: found {trials}, expected at least 2")
    printed = printed_numbers()
    work = _Work(printed, trials, seed, progress, workers)
    calibrations = work.calibrations()
    noise, cells = work.table_ix()
    tables = (
        work.table_i(),
        work.poses("II", "calibration poses of the fixture", printed.fixture),
        work.poses("III", "calibration poses of the closed loop", printed.closed_loop),
        work.parameters("IV", "calibrated offsets (rad)", "offsets", calibrations),
        work.parameters("V", "calibrated gains (1e-3 rad/count)", "gains", calibrations),
        work.table_vi(),
        work.table_vii(),
        work.table_viii(),
        noise,
        work.convergence(),
        work.calibration_table(calibrations),
        work.bounds(),
    )
    work.say("misprints", 0, 1)
    found = misprints(printed, cells, max(2, trials // 2), seed)
    work.say("misprints", 1, 1)
    return Paper("rsicalib.paper/1", _core.__version__, trials, seed, tables, found)


def printed_numbers() -> Printed:
    """What the paper prints, from the file that comes with the package.

    Returns
    -------
    Printed
        In arrays, pose 3 of Table II corrected beside the table as printed.
    """
    text = files("rsicalib").joinpath("reproduction/tables.toml").read_text(encoding="utf-8")
    numbers = tomllib.loads(text)

    def poses(name: str) -> FloatArray:
        return np.array(numbers["poses"][name], dtype=np.float64) * ([1] * 3 + [np.pi] * 3)

    fixture = poses("fixture_printed")
    fixture[2, 2] = fixture[3, 2]
    mechanism = Mechanism.rsi()
    sets = {
        name: Device(
            mechanism,
            np.array(numbers["offsets"][name], dtype=np.float64).ravel(),
            np.array(numbers["gains"][name], dtype=np.float64).ravel() * 1e-3,
        )
        for name in ("I", "II", "III")
    }
    return Printed(
        numbers,
        poses("fixture_printed"),
        fixture,
        poses("closed_loop"),
        nominal_device(mechanism),
        sets,
    )


# ------------------------------------------------------------------ the tables


@dataclass(frozen=True)
class _Trials:
    """What one way of calibrating found in many simulations of section IV."""

    label: str
    offsets: FloatArray
    gains: FloatArray
    errors: FloatArray
    """Offsets, gains, joint angles, orientation, position: rms of each trial."""
    failed: int

    def cells(self) -> list[Estimate]:
        return [Estimate.of(column) for column in self.errors.T]


class _Work:
    """The tables of one run."""

    def __init__(
        self,
        printed: Printed,
        trials: int,
        seed: int,
        progress: Callable[[str, int, int], None] | None,
        workers: int | None,
    ) -> None:
        self.printed = printed
        self.numbers = printed.numbers
        self.device = printed.sets["I"]
        self.mechanism = self.device.mechanism
        self.trials, self.seed = trials, seed
        self.say = progress or (lambda _what, _done, _of: None)
        self.workers = workers

    def told(self, what: str) -> Progress:
        return lambda done, of: self.say(what, done, of)

    # -------------------------------------------------------------- I to III

    def table_i(self) -> Table:
        g = self.numbers["geometry"]
        plain = self.mechanism.to_dict()
        dh = plain["chain"][0]["dh"]
        printed_a = (g["l1"], g["l2"], 0.0, 0.0)
        rows = [
            Row(
                f"j = {j}",
                (
                    Cell(row.get("a", 0.0), printed_a[j]),
                    Cell(row.get("d", 0.0), 0.0),
                    Cell(row.get("alpha", 0.0), g["alpha"][j]),
                ),
            )
            for j, row in enumerate(dh)
        ]
        rows += [
            Row(f"arm {i}: θi0", (Cell(chain["dh"][0]["theta"], g["theta_i0"][i - 1]),))
            for i, chain in enumerate(plain["chain"], start=1)
        ]
        rows.append(Row("wrist on x_i3 (l3)", (Cell(plain["point"][0]["at"][0], g["l3"]),)))
        return Table(
            "I",
            "Denavit-Hartenberg constants of each arm",
            ("a [in]", "s [in]", "α [rad]"),
            tuple(rows),
            "reproduced",
            ("The right column is headed “a (rad)” in the paper; it is the twist α.",),
        )

    def poses(self, table: str, title: str, poses: FloatArray) -> Table:
        found = _core.rsi_poses(_core.rsi_angles(poses))
        rows = [
            Row(str(m), tuple(Cell(_near(f), p) for f, p in zip(back, pose, strict=True)))
            for m, (back, pose) in enumerate(zip(found.tolist(), poses.tolist(), strict=True), 1)
        ]
        angles = _core.rsi_angles(poses).reshape(-1, 3, 3)
        low, high = angles.min(axis=(0, 1)), angles.max(axis=(0, 1))
        spans = ", ".join(
            f"θi{j} {a:.2f} … {b:.2f}"
            for j, a, b in zip((1, 2, 3), low.tolist(), high.tolist(), strict=True)
        )
        notes = [
            "Computed: inverse kinematics (6)-(8), then forward (2)-(5). Within the joint limits "
            f"of Fig. 4: {spans} rad."
        ]
        if table == "II":
            notes.insert(0, "Pose 3 is printed with z = -3.966; see the misprints.")
        return Table(table, title, POSE, tuple(rows), "reproduced", tuple(notes))

    # -------------------------------------------------------------- IV, V

    def parameters(
        self, table: str, title: str, what: str, calibrations: Mapping[str, _Trials]
    ) -> Table:
        scale = 1.0 if what == "offsets" else 1e3
        spread = {
            name: getattr(calibrations[label], what).std(axis=0, ddof=1) * scale
            for name, label in (("I", OPEN), ("II", CLOSED), ("III", BOTH))
        }
        values = {name: getattr(d, what) * scale for name, d in self.printed.sets.items()}
        rows = []
        for k, joint in enumerate(JOINTS):
            cells = [Cell(None, float(values[name][k])) for name in values]
            cells += [Cell(float(spread[name][k])) for name in spread]
            rows.append(Row(f"{'θ' if what == 'offsets' else 'k'}{joint}", tuple(cells)))
        off = {
            name: _rms((values[name] - values["I"]) / np.hypot(spread[name], spread["I"]))
            for name in ("II", "III")
        }
        symbol = "offset" if what == "offsets" else "gain"
        return Table(
            table,
            title,
            ("I", "II", "III", "sd of I", "sd of II", "sd of III"),
            tuple(rows),
            "as printed",
            (
                "The readings were never published, so the estimates cannot be computed again. "
                f"sd: of the estimates when section IV is simulated with {NOISE:g} count of noise "
                "on a device that is exactly set I.",
                f"Set II differs from I by {off['II']:.1f} times what that noise explains, "
                f"{symbol} by {symbol} (rms), set III by {off['III']:.1f} times: where it is well "
                "above 1, something else than noise was at work in the real device.",
            ),
        )

    # -------------------------------------------------------------- VI, VII

    def table_vi(self) -> Table:
        printed = self.numbers["accuracy"]
        exact = self.device.readings(self.printed.fixture)
        own = printed["I"]
        rows = [Row("I", tuple(Cell(None, p) for p in own))]
        alone = {}
        for name in ("II", "III"):
            device = self.printed.sets[name]
            errors = _errors(device.offsets, device.gains, exact, self.printed.fixture)
            alone[name] = errors
            cells = (
                Cell(math.hypot(e, r), p)
                for e, r, p in zip(errors, own, printed[name], strict=True)
            )
            rows.append(Row(name, tuple(cells)))
        without = "; ".join(f"{n}: {a:.3f}, {o:.3f}, {p:.3f}" for n, (a, o, p) in alone.items())
        return Table(
            "VI",
            "rms errors on the poses of the fixture",
            ("joint angles [rad]", "orientation [rad]", "position [in]"),
            tuple(rows),
            "reproduced",
            (
                "From Tables II, IV and V alone: set I turns the poses into readings, II and III "
                "turn those into joint angles and poses. Set I's own printed residual, which that "
                f"leaves out, is added in quadrature; without it: {without}.",
                "Row I is the residual of readings that were never published.",
            ),
        )

    def table_vii(self) -> Table:
        first = self.device
        rows = []
        for name in ("II", "III"):
            device, p = self.printed.sets[name], self.numbers["against_I"][name]
            off, gain = _rms(device.offsets - first.offsets), _rms(device.gains - first.gains) * 1e3
            rows.append(Row(name, (Cell(off, p[0]), Cell(gain, p[1]))))
        return Table(
            "VII",
            "rms differences from set I",
            ("offsets [rad]", "gains [1e-3 rad/count]"),
            tuple(rows),
            "reproduced",
            (
                "Scan 001 repeats two rows of Table VI here; the figures beside are those that "
                "Tables IV and V give, in our transcription of the paper.",
            ),
        )

    # -------------------------------------------------------------- VIII

    def table_viii(self) -> Table:
        printed = self.numbers["observability"]
        exact = {
            "II": self.device.readings(self.printed.fixture),
            "III": self.device.readings(self.printed.closed_loop),
        }
        exact["II and III"] = np.vstack([exact["II"], exact["III"]])
        key = {"II": "II", "III": "III", "II and III": "II_III"}
        count = 25
        rng = np.random.default_rng(self.seed)
        by_hand = placed(self.device, self.printed.closed_loop, self._placement(), rng, count)
        rows, found = [], {}
        for name in exact:
            sets = [exact["II"]] * count if name == "II" else list(by_hand)
            if name == "II and III":
                sets = [np.vstack([exact["II"], own]) for own in by_hand]
            for scaling in SCALINGS:
                values = np.array([self._measured(own, scaling) for own in sets])
                found[name, scaling] = np.median(values, axis=0)
                shown = zip(found[name, scaling].tolist(), printed[key[name]], strict=True)
                rows.append(Row(f"{name}, {scaling}", tuple(Cell(c, p) for c, p in shown)))
        order = all(
            found["II", s][1] > found["III", s][1] > found["II and III", s][1]
            and found["II", s][2] < found["III", s][2] < found["II and III", s][2]
            for s in SCALINGS[1:]
        )
        fixed = self._measured(exact["III"], "wrist_position")[1]
        return Table(
            "VIII",
            "observability under closed-loop calibration, at set I",
            ("O1", "condition number", "smallest singular value"),
            tuple(rows),
            "order only" if order else "not reproduced",
            (
                "The paper scales the columns by [18], whose figures it does not give: under no "
                "scaling here do its figures come out. The order of the three data sets does, by "
                "condition number and smallest singular value alike."
                if order
                else "Neither the figures nor their order come out.",
                f"Table III as placed by hand (median of {count} placements with the errors of "
                f"section IV-C); exactly as printed its condition number would be {fixed:.0f}.",
                "none: columns as they are, rad beside rad/count; unit_columns: each of length "
                "one; wrist_position: each by how far its parameter moves the wrists (rms).",
            ),
        )

    def _measured(self, exact: FloatArray, scaling: str) -> list[float]:
        """O1, condition number, smallest singular value at set I."""
        d = self.device
        found = _core.observability(d.mechanism, exact, d.offsets, d.gains, scaling)["measures"]
        return [found["o1"], found["condition"], found["o3"]]

    def _placement(self) -> tuple[float, float]:
        error = self.numbers["poses"]["placement_error_rms"]
        return float(error["position_in"]), float(error["orientation_rad"])

    # -------------------------------------------------------------- IX

    def table_ix(self) -> tuple[Table, dict[str, float]]:
        printed = self.numbers["noise"]
        rows, cells = [], {}
        for average in (2, 100):
            table = printed[f"closed_average_{average}"]
            for noise in (0, 1, 2, 4):
                name = f"closed {average} {noise}"
                found = closed_loop_noise(
                    self.printed.nominal,
                    self.printed.closed_loop,
                    noise=noise,
                    average=average,
                    trials=self.trials,
                    seed=self.seed,
                    progress=self.told(f"Table IX, {name}"),
                    workers=self.workers,
                )
                cells[name] = found.offset.value
                if noise or average == 2:
                    label = f"closed loop, average {average}, " + _level(noise)
                    rows.append(
                        _noise_row(label, found, table["truncation" if not noise else str(noise)])
                    )
        angle = float(printed["open_loop_angle_noise_rad"])
        for average in (2, 100):
            table = printed[f"open_average_{average}"]
            for noise in (0, 1, 2, 4):
                if not noise and average == 100:
                    continue
                for averaged in (True, False):
                    name = f"Table IX, open {average} {noise}"
                    found = open_loop_noise(
                        self.printed.nominal,
                        self.printed.fixture,
                        noise=noise,
                        average=average,
                        angle_noise=angle,
                        average_angles=averaged,
                        trials=self.trials,
                        seed=self.seed,
                        progress=self.told(name),
                        workers=self.workers,
                    )
                    how = "angles averaged" if averaged else "angles not averaged"
                    label = f"open loop, average {average}, {_level(noise)}, {how}"
                    rows.append(
                        _noise_row(label, found, table["truncation" if not noise else str(noise)])
                    )
        title = "noise and averaging: rms error of one calibration, mean over trials"
        columns = ("offsets [rad]", "gains [1e-3 rad/count]")
        notes = (
            "Closed loop: reproduced with “variance” read as standard deviation in counts, poses "
            "placed with N(0, 0.25) in and rad, samples rounded, and their average rounded again; "
            "see the misprints.",
            f"Open loop: not reproduced. With noise of {angle} rad in the angles of each sample, "
            "averaged with them, errors fall with the samples as printed but are too small; with "
            "one error for each pose they do not fall at all.",
        )
        return Table("IX", title, columns, tuple(rows), "partly reproduced", notes), cells

    # -------------------------------------------------------------- convergence

    def convergence(self) -> Table:
        printed = self.numbers["convergence"]
        nominal, poses = self.printed.nominal, self.printed.closed_loop
        gain = float(nominal.gains[0]) * 1e3
        flat = poses * [1, 1, 0, 1, 1, 1]
        rows, islands = [], []
        cases: list[tuple[str, FloatArray, bool, Sequence[float] | None]] = [
            ("Table III", poses, False, printed["closed_loop_poses"]),
            ("Table III with z = 0", flat, False, printed["closed_loop_poses_z0"]),
            ("Table III, anchored at rest", poses, True, None),
            ("Table III with z = 0, anchored at rest", flat, True, None),
        ]
        for k, (label, where, anchored, shown) in enumerate(cases):
            self.say("convergence", k, len(cases) + 1)
            region = convergence_equal(nominal, where, anchored=anchored)
            low, high = gain * region.high, gain * region.low
            rows.append(
                Row(
                    label,
                    (
                        Cell(low, None if shown is None else shown[0]),
                        Cell(high, None if shown is None else shown[1]),
                    ),
                )
            )
            for first, last in region.islands:
                islands.append(f"{label}: also {gain * last:.3f} … {gain * first:.3f}")
        rng = np.random.default_rng(self.seed)
        sd = self.numbers["convergence"]["pose_perturbation_sd"]
        placement = (float(sd["position_in"]), float(sd["orientation_rad"]))
        count = 40
        ends = []
        for own in placed(nominal, poses, placement, rng, count):
            region = convergence_equal(nominal, _poses_of(nominal, own))
            ends.append([gain * region.high, gain * region.low])
        estimates = [Estimate.of(column) for column in np.array(ends).T]
        rows.append(
            Row(
                f"Table III placed by hand, mean of {count}",
                tuple(Cell(e.value, None, e.sd) for e in estimates),
            )
        )
        few = max(20, min(self.trials, 200))
        notes = list(islands)
        for anchored, words in ((False, "the paper's start"), (True, "anchored at rest")):
            how: dict[str, Any] = {"anchored": anchored, "seed": self.seed, "workers": self.workers}
            told = self.told(f"convergence, {words}")
            far = convergence_independent(nominal, poses, trials=few, progress=told, **how)
            rates = start_success(nominal, poses, (0.1, 0.2, 0.5), trials=few, **how)
            shares = ", ".join(
                f"±{s.error:.0%} {s.rate.value:.0%} ± {s.rate.sd or 0:.0%}" for s in rates
            )
            notes.append(
                f"Independent gain errors, {words}, {few} draws: succeeds from {shares}; along a "
                f"random direction the edge is at {np.quantile(far, 0.1):.0%} (first tenth), "
                f"{np.median(far):.0%} (median) of the largest error."
            )
        notes += [
            "Edges by bisection from -1.449e-3; the paper's are from MATLAB's solver of 1993, and "
            "an edge belongs to a solver as much as to a problem. For z = 0 the printed interval "
            "is not reproduced: its lower end lies beyond islands that no bisection would find "
            "from the inside.",
            "Anchored: offsets start at θ_rest - k a_rest, so that a wrong gain swings a joint "
            "about the rest pose instead of count zero.",
        ]
        return Table(
            "convergence",
            "starting gains (1e-3 rad/count), all alike, from which the truth is found",
            ("from", "to"),
            tuple(rows),
            "partly reproduced",
            tuple(notes),
        )

    # -------------------------------------------------------------- section IV, simulated

    def calibrations(self) -> dict[str, _Trials]:
        """The calibrations of section IV on simulated readings."""
        trials = max(2, self.trials // 2)
        jig = self.device.readings(self.printed.fixture)
        angles = _core.rsi_angles(self.printed.fixture)
        names = [c["name"] for c in self.mechanism.to_dict()["closure"]]
        start = self.printed.nominal
        residual = float(self.numbers["accuracy"]["I"][0])

        def job(rng: np.random.Generator, size: int) -> dict[str, list[FloatArray]]:
            own = placed(self.device, self.printed.closed_loop, self._placement(), rng, size)
            found: dict[str, list[FloatArray]] = {label: [] for label in WAYS}
            for exact in own:
                many = self._read(jig, rng, 100)
                off = angles + residual * rng.standard_normal(angles.shape)
                two = self._read(exact, rng, 2)
                both = np.vstack([many, two])
                found[OPEN].append(np.concatenate(fixture_lines(many, off)))
                for label, read in ((JIG, many), (CLOSED, two), (BOTH, both)):
                    found[label].append(self._closed(read, start, None))
                for name in names:
                    found[f"{PAIR}{name}"].append(self._closed(both, start, [name]))
            return found

        WAYS = [OPEN, CLOSED, BOTH, JIG, *(f"{PAIR}{name}" for name in names)]
        told = self.told("section IV")
        chunks = run(job, trials, self.seed, progress=told, workers=self.workers)
        return {
            label: self._judged(label, np.array([x for chunk in chunks for x in chunk[label]]), jig)
            for label in WAYS
        }

    def _read(self, exact: FloatArray, rng: np.random.Generator, samples: int) -> FloatArray:
        """Averages, rounded again as those of Table IX are."""
        read = self.device.sample(exact, rng, noise=NOISE, samples=samples).mean(axis=1)
        out: FloatArray = np.round(read)
        return out

    def _closed(self, read: FloatArray, start: Device, closures: list[str] | None) -> FloatArray:
        offsets, gains, *_ = _core.minimize(
            self.mechanism, read, start.offsets, start.gains, closures=closures, max_iterations=300
        )
        return np.concatenate([offsets, gains])

    def _judged(self, label: str, found: FloatArray, jig: FloatArray) -> _Trials:
        offsets, gains = found[:, :9], found[:, 9:]
        arms = np.ones(9, dtype=bool)
        if label.startswith(PAIR):
            wrists = label.removeprefix(PAIR).split("-")
            arms = np.repeat([f"wrist{i}" in wrists for i in (1, 2, 3)], 3)
        good = np.all(np.abs(gains / self.device.gains - 1)[:, arms] < 0.5, axis=1)
        errors = []
        for o, g in zip(offsets[good], gains[good], strict=True):
            row = [_rms((o - self.device.offsets)[arms]), _rms((g - self.device.gains)[arms]) * 1e3]
            angle = np.sqrt(
                np.mean((jig * (g - self.device.gains) + o - self.device.offsets)[:, arms] ** 2)
            )
            row.append(float(angle))
            if arms.all():
                row += _errors(o, g, jig, self.printed.fixture)[1:]
            errors.append(row)
        width = 5 if arms.all() else 3
        return _Trials(
            label,
            offsets[good],
            gains[good],
            np.array(errors).reshape(-1, width),
            int((~good).sum()),
        )

    def calibration_table(self, calibrations: Mapping[str, _Trials]) -> Table:
        """Section IV and the Discussion: what each way of calibrating is worth."""
        printed: dict[str, list[float | None]] = {
            CLOSED: [*self.numbers["against_I"]["II"], *self.numbers["accuracy"]["II"]],
            BOTH: [*self.numbers["against_I"]["III"], *self.numbers["accuracy"]["III"]],
        }
        rows = []
        for label, found in calibrations.items():
            shown = printed.get(label, [None] * 5)
            cells = found.cells()
            rows.append(
                Row(
                    label + (f" ({found.failed} failed)" if found.failed else ""),
                    tuple(Cell(e.value, p, e.sd) for e, p in zip(cells, shown, strict=False)),
                )
            )
        ratio = calibrations[JIG].cells()[0].value / calibrations[BOTH].cells()[0].value
        count = len(calibrations[OPEN].offsets)
        pairs = [t for label, t in calibrations.items() if label.startswith(PAIR)]
        lost = sum(t.failed for t in pairs)
        every = lost + sum(len(t.offsets) for t in pairs)
        return Table(
            "calibrations",
            "section IV simulated on a device that is exactly set I: errors against the truth",
            (
                "offsets [rad]",
                "gains [1e-3 rad/count]",
                "joint angles [rad]",
                "orientation [rad]",
                "position [in]",
            ),
            tuple(rows),
            "simulated",
            (
                f"{count} trials: {NOISE:g} count of noise, 100 samples of each pose of Table II "
                "and 2 of Table III, averaged and rounded as for Table IX; Table III is placed "
                "with the errors of section IV-C; joint angles of the fixture are off by "
                f"{self.numbers['accuracy']['I'][0]} rad, set I's residual. "
                "Every search starts at the nominal parameters. rms of one calibration, mean over "
                "trials; the last three columns are on the poses of the fixture.",
                "Printed figures are differences from set I of the real device, which carry set "
                "I's own errors and everything that a simulation leaves out.",
                f"Table II alone is {ratio:.0f} times worse than II and III together (printed: "
                "over 10 times).",
                f"One loop at a time on II and III, {every} searches: {lost} did not converge. In "
                "the paper none did, and its simulations were inconclusive.",
            ),
        )

    def bounds(self) -> Table:
        """What any method could have known from these poses."""
        hand = placed(
            self.device,
            self.printed.closed_loop,
            self._placement(),
            np.random.default_rng(self.seed),
            100,
        )
        sigma = np.ones(9)

        def limit(exact: FloatArray) -> float:
            d = self.device
            sd = _core.bound(d.mechanism, exact, d.offsets, d.gains, sigma)["offset_sd"]
            return _rms(np.array(sd))

        by_hand = Estimate.of([limit(own) for own in hand])
        jig = self.device.readings(self.printed.fixture)
        both = Estimate.of([limit(np.vstack([jig, own])) for own in hand])
        exact = self.device.readings(self.printed.closed_loop)
        rows = (
            Row("Table II", (Cell(limit(jig)),)),
            Row("Table III, exactly", (Cell(limit(exact)),)),
            Row("Table III as placed by hand", (Cell(by_hand.value, None, by_hand.sd),)),
            Row("II and III as placed by hand", (Cell(both.value, None, both.sd),)),
        )
        return Table(
            "bound",
            "least standard deviation of the offsets per count of noise, one reading of each pose",
            ("offsets [rad]",),
            rows,
            "ours",
            (
                "Cramér-Rao, rms over the nine offsets. `rsicalib plan` finds twelve poses that "
                "need no more than 0.0045.",
            ),
        )


OPEN = "I: fixture, Table II"
CLOSED = "II: closed loop, Table III"
BOTH = "III: closed loop, II and III"
JIG = "closed loop, Table II alone"
PAIR = "one loop, II and III: "


# ------------------------------------------------------------------ small parts


def _errors(
    offsets: FloatArray, gains: FloatArray, readings: FloatArray, poses: FloatArray
) -> list[float]:
    """Table VI: rms of joint angles, orientation and position on known poses."""
    angles = readings * gains + offsets
    found = _core.rsi_poses(np.ascontiguousarray(angles)) - poses
    turn = (found[:, 3:] + np.pi) % (2 * np.pi) - np.pi
    return [_rms(angles - _core.rsi_angles(poses)), _rms(turn), _rms(found[:, :3])]


def _poses_of(device: Device, exact: FloatArray) -> FloatArray:
    found: FloatArray = _core.rsi_poses(np.ascontiguousarray(exact * device.gains + device.offsets))
    return found


def _noise_row(label: str, found: NoiseCell, printed: Sequence[float]) -> Row:
    off, gain = found.offset, found.gain
    if found.failed:
        label += f" ({found.failed} failed)"
    return Row(
        label,
        (
            Cell(off.value, printed[0], off.sd),
            Cell(gain.value * 1e3, printed[1], None if gain.sd is None else gain.sd * 1e3),
        ),
    )


def _level(noise: int) -> str:
    return f"σ = {noise}" if noise else "truncation"


def _figure(cell: Cell) -> str:
    out = "-" if cell.computed is None else f"{cell.computed:.4g}"
    if cell.sd is not None:
        out += f" ± {cell.sd:.1g}"
    return out if cell.printed is None else f"{out} ({cell.printed:.4g})"


def _near(value: float) -> float:
    """A figure without the rounding of a round trip."""
    return round(value, 9) + 0.0


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
