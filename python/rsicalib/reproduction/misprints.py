"""The paper's misprints, each settled by a calculation rather than by opinion.

Every function evaluates what is printed and what it should be, with plain numpy where a formula
is in doubt, and says in numbers which of the two holds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.devices import Device
from rsicalib.records import Record
from rsicalib.reproduction.convergence import NoiseCell, closed_loop_noise, fixture_lines

__all__ = ["Misprint", "Printed", "misprints"]


@dataclass(frozen=True)
class Printed:
    """What the paper prints, in arrays, and the devices that its parameters make.

    Attributes
    ----------
    numbers : mapping
        The file `reproduction/tables.toml`.
    fixture_printed, fixture, closed_loop : ndarray, shape (12, 6)
        Table II as printed and corrected, Table III.
    nominal : Device
        Nominal offsets and gains.
    sets : dict of str to Device
        Parameter sets I, II, III of Tables IV and V.
    """

    numbers: Mapping[str, Any]
    fixture_printed: FloatArray
    fixture: FloatArray
    closed_loop: FloatArray
    nominal: Device
    sets: dict[str, Device]


@dataclass(frozen=True)
class Misprint(Record):
    """A place where the paper cannot mean what it prints.

    Attributes
    ----------
    where, printed, right : str
        The place, what stands there, and what should.
    why : str
        The calculation, with its numbers.
    evidence : dict of str to float
        The numbers alone.
    """

    where: str
    printed: str
    right: str
    why: str
    evidence: dict[str, float]


def misprints(
    paper: Printed, averages: Mapping[str, float], trials: int, seed: int
) -> tuple[Misprint, ...]:
    """Re-derive every misprint.

    Parameters
    ----------
    paper : Printed
        The paper's numbers.
    averages : mapping of str to float
        Computed cells of Table IX by name, as `rsicalib.paper` has them.
    trials, seed : int
        Of what has to be simulated besides.

    Returns
    -------
    tuple of Misprint
        In the order of the paper.
    """
    simple: list[Callable[[Printed], Misprint]] = [
        _table_i, _eq_4, _eq_5, _ranges, _eq_8, _eq_12, _eq_13, _table_ii, _offset_3,
        _offset_from, _table_vii, _jacobian, _discussion,
    ]  # fmt: skip
    return (*(one(paper) for one in simple), *_table_ix(paper, averages, trials, seed))


# ------------------------------------------------------------------ kinematics


def _turn(poses: FloatArray) -> FloatArray:
    """Eq. (1): shape (n, 3, 3)."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(poses[:, 3:]).T, np.sin(poses[:, 3:]).T
    rows = [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _wrists(paper: Printed, poses: FloatArray) -> FloatArray:
    """`r_i = r_H + R q_i`, wrists clockwise from above: shape (n, 3, 3)."""
    around = -2 * np.pi / 3 * np.arange(3)
    q = paper.numbers["geometry"]["l4"] * np.stack([np.cos(around), np.sin(around), 0 * around], 1)
    out: FloatArray = poses[:, None, :3] + np.einsum("nij,wj->nwi", _turn(poses), q)
    return out


def _in_arms(paper: Printed, wrists: FloatArray) -> FloatArray:
    """Wrists in the frames of the arms, `r_i0`: shape (n, 3, 3)."""
    g = paper.numbers["geometry"]
    cos, sin, zero = np.cos(g["theta_i0"]), np.sin(g["theta_i0"]), np.zeros(3)
    turn = np.array([[cos, zero, sin], [sin, zero, -cos], [zero, zero + 1, zero]])
    off = wrists - g["l1"] * np.stack([cos, sin, zero], axis=1)
    out: FloatArray = np.einsum("jiw,nwj->nwi", turn, off)
    return out


def _plane(paper: Printed, angles: FloatArray) -> FloatArray:
    """Eq. (2): `r_i0` of joint angles of shape (n, 3, 3)."""
    g = paper.numbers["geometry"]
    t1, t2, t3 = np.moveaxis(angles, -1, 0)
    reach = g["l3"] * np.cos(t3)
    x = g["l2"] * np.cos(t1) + reach * np.cos(t1 + t2)
    y = g["l2"] * np.sin(t1) + reach * np.sin(t1 + t2)
    return np.stack([x, y, g["l3"] * np.sin(t3)], axis=-1)


def _some_poses(paper: Printed) -> FloatArray:
    """The poses of Tables II and III, and others in between: all axes turn at once."""
    rng = np.random.default_rng(0)
    wide = [0.8, 0.8, 0.8, 0.4, 0.4, 0.4]
    more = np.array([0, 0, -2.5, 0, 0, 0]) + rng.uniform(-1, 1, (20, 6)) * wide
    return np.vstack([paper.fixture, paper.closed_loop, more])


def _angles(poses: FloatArray) -> FloatArray:
    found: FloatArray = _core.rsi_angles(np.ascontiguousarray(poses))
    return found


# ------------------------------------------------------------------ one by one


def _table_i(paper: Printed) -> Misprint:
    poses = _some_poses(paper)
    mechanism = paper.nominal.mechanism
    chain = np.array([mechanism.inverse(pose.tolist()) for pose in poses])
    worst = float(np.abs(chain - _angles(poses)).max())
    return Misprint(
        "Table I, header",
        "a, s, a (rad)",
        "a, s, α (rad)",
        "The chain with the last column as twists α = π/2, 0, π/2, 0 reaches the same wrists as "
        f"eq. (2): joint angles of {len(poses)} poses agree to {worst:.0e} rad.",
        {"largest difference, rad": worst},
    )


def _eq_4(paper: Printed) -> Misprint:
    r = _wrists(paper, _some_poses(paper))
    scale = 2 / (paper.numbers["geometry"]["l4"] * np.sqrt(3))
    printed = np.linalg.norm(scale * (r[:, 2] - (r[:, 2] - r[:, 1]) / 2), axis=1)
    right = np.linalg.norm(scale * (r[:, 2] - (r[:, 2] + r[:, 1]) / 2), axis=1)
    return Misprint(
        "eq. (4)",
        "r3 - (r3 - r2)/2",
        "r3 - (r3 + r2)/2",
        f"y_H is an axis: its length is {right.min():.6f} to {right.max():.6f} with the plus sign, "
        f"{printed.min():.2f} to {printed.max():.2f} as printed.",
        {"length as printed, largest": float(printed.max()), "length, largest": float(right.max())},
    )


def _eq_5(paper: Printed) -> Misprint:
    poses = _some_poses(paper)
    x, y, z = np.moveaxis(_turn(poses), 2, 0)
    tz = np.arctan2(x[:, 1], x[:, 0])
    along = x[:, 0] * np.cos(tz) + x[:, 1] * np.sin(tz)
    printed = np.stack([np.arctan2(x[:, 2], along), np.arctan2(y[:, 2], z[:, 2])], axis=1)
    right = np.stack([np.arctan2(y[:, 2], z[:, 2]), np.arctan2(-x[:, 2], along)], axis=1)
    wrong = float(np.abs(printed - poses[:, 3:5]).max())
    error = float(np.abs(right - poses[:, 3:5]).max())
    return Misprint(
        "eq. (5)",
        "θy = atan2(yH3, zH3), θx = atan2(xH3, …)",
        "θx = atan2(yH3, zH3), θy = atan2(-xH3, …)",
        f"Taking the angles out of eq. (1) again is off by up to {wrong:.2f} rad as printed, by "
        f"{error:.0e} rad with the two exchanged and the sign turned.",
        {"error as printed, rad": wrong, "error, rad": error},
    )


def _ranges(paper: Printed) -> Misprint:
    angles = _angles(np.vstack([paper.fixture, paper.closed_loop])).reshape(-1, 3, 3)
    low, high = angles.min(axis=(0, 1)), angles.max(axis=(0, 1))
    return Misprint(
        "section II-B",
        "±0.7 rad for θi2, -1.0 to -2.2 rad for θi3",
        "±0.7 rad for θi3, -1.0 to -2.2 rad for θi2",
        f"Over Tables II and III θi2 runs from {high[1]:.2f} to {low[1]:.2f} rad, θi3 from "
        f"{low[2]:.2f} to {high[2]:.2f} rad; by Fig. 4 θi2 cannot be positive.",
        {
            "lowest θi2": float(low[1]),
            "highest θi2": float(high[1]),
            "lowest θi3": float(low[2]),
            "highest θi3": float(high[2]),
        },
    )


def _eq_8(paper: Printed) -> Misprint:
    g = paper.numbers["geometry"]
    r = _in_arms(paper, _wrists(paper, _some_poses(paper)))
    t3 = np.arcsin(r[..., 2] / g["l3"])
    reach, rho = g["l3"] * np.cos(t3), np.hypot(r[..., 0], r[..., 1])
    t2 = -np.arccos((rho**2 - g["l2"] ** 2 - reach**2) / (2 * g["l2"] * reach))
    inner = np.arccos((rho**2 + g["l2"] ** 2 - reach**2) / (2 * g["l2"] * rho))
    error = {}
    for sign in (-1, 1):
        t1 = np.arctan2(r[..., 1], r[..., 0]) + sign * inner
        back = _plane(paper, np.stack([t1, t2, t3], axis=-1))
        error[sign] = float(np.linalg.norm(back - r, axis=-1).max())
    return Misprint(
        "eq. (8)",
        "- acos(…) + atan(…)",
        "+ acos(…) + atan2(…)",
        "From a wrist by (6)-(8) to angles and back by (2) misses it by up to "
        f"{error[-1]:.2f} in as printed, by {error[1]:.0e} in with the plus sign: the elbow is in "
        "quadrants III, IV, so θi2 ≤ 0.",
        {"error as printed, in": error[-1], "error, in": error[1]},
    )


def _eq_12(paper: Printed) -> Misprint:
    device = paper.nominal
    exact = device.readings(paper.closed_loop)
    jacobian = _core.jacobian(device.mechanism, exact, device.offsets, device.gains)

    def f(offsets: FloatArray, gains: FloatArray) -> FloatArray:
        return _core.misclosure(device.mechanism, exact, offsets, gains).ravel()

    step = 1e-5
    by_gain = np.empty((len(jacobian), 9))
    by_offset = np.empty_like(by_gain)
    for i, unit in enumerate(np.eye(9)):
        off, gain = step * unit, step / 2048 * unit
        plus, minus = f(device.offsets + off, device.gains), f(device.offsets - off, device.gains)
        by_offset[:, i] = (plus - minus) / (2 * step)
        plus, minus = f(device.offsets, device.gains + gain), f(device.offsets, device.gains - gain)
        by_gain[:, i] = (plus - minus) / (2 * step / 2048)
    same = float(np.abs(by_offset - jacobian[:, :9]).max())
    gains = float(np.abs(by_gain - jacobian[:, 9:]).max() / np.abs(jacobian[:, 9:]).max())
    return Misprint(
        "eq. (12)",
        "∂f/∂θij",
        "∂f/∂θij_off",
        "The unknowns of (11) are offsets and gains. As θ = k a + θ_off the two derivatives are "
        f"one number (differences by the offset agree with it to {same:.0e}), so nothing goes "
        f"wrong; those by the gain are a times as large (agree to {gains:.0e}).",
        {"offset column, in²/rad": same, "gain column, relative": gains},
    )


def _eq_13(paper: Printed) -> Misprint:
    device = paper.sets["I"]
    exact = device.readings(paper.fixture)
    angles = _angles(paper.fixture)
    offsets, _ = fixture_lines(exact, angles)
    # (θ - k a + o)² is smallest where o is minus the offset of (9).
    column = np.column_stack([exact[:, 0], -np.ones(len(exact))])
    _, printed = np.linalg.lstsq(column, angles[:, 0], rcond=None)[0]
    error = float(np.abs(offsets - device.offsets).max())
    return Misprint(
        "eq. (13)",
        "(θ - k a + θ_off)²",
        "(θ - k a - θ_off)²",
        f"With the sign of (9) the offsets of set I come back to {error:.0e} rad; with the sign as "
        f"printed θ11_off comes out as {printed:.3f} where Table IV has {device.offsets[0]:.3f}.",
        {"error, rad": error, "θ11_off as printed, rad": float(printed)},
    )


def _table_ii(paper: Printed) -> Misprint:
    printed = paper.numbers["sensor"]["offset_nominal"][:2]
    wrong, right = (_rest_offsets(paper, z) for z in (-3.966, -2.666))
    # Between which heights do both offsets round to what is printed?
    heights = np.arange(-4.2, -2.0, 1e-3)
    fits = [
        z
        for z in heights.tolist()
        if np.all(np.round(_rest_offsets(paper, z)[:2], 2) == np.array(printed))
    ]
    return Misprint(
        "Table II, pose 3",
        "z = -3.966, the same as pose 1",
        "z = -2.666",
        f"Pose 3 is the rest pose of (14), and the text prints its offsets {printed[0]:.2f} and "
        f"{printed[1]:.2f}: z = -2.666 gives {right[0]:.3f} and {right[1]:.3f}, z = -3.966 gives "
        f"{wrong[0]:.3f} and {wrong[1]:.3f}; only z from {fits[0]:.3f} to {fits[-1]:.3f} rounds to "
        "both, and -2.666 is the table's one height among them.",
        {
            "offset 1 at -2.666": float(right[0]),
            "offset 2 at -2.666": float(right[1]),
            "offset 1 at -3.966": float(wrong[0]),
            "offset 2 at -3.966": float(wrong[1]),
            "lowest z": fits[0],
            "highest z": fits[-1],
        },
    )


def _rest_offsets(paper: Printed, z: float) -> FloatArray:
    """Eq. (14) with the handle level at a height."""
    angles = _angles(np.array([[0.0, 0.0, z, 0.0, 0.0, 0.0]]))[0, :3]
    out: FloatArray = angles - paper.nominal.gains[0] * paper.numbers["sensor"]["rest_counts"]
    return out


def _offset_3(paper: Printed) -> Misprint:
    printed = paper.numbers["sensor"]["offset_nominal"][2]
    found = np.array([_rest_offsets(paper, z)[2] for z in np.linspace(-5, -1.5, 50)])
    coarse = -paper.numbers["sensor"]["gain_nominal"] * paper.numbers["sensor"]["rest_counts"]
    return Misprint(
        "nominal offset of joint 3",
        f"{printed} rad",
        f"{found.mean():.3f} rad",
        f"With the handle level θi3 = 0 at any height, so (14) gives {found.min():.3f} to "
        f"{found.max():.3f} for z from -5 to -1.5, half of 340°; with the rounded gain of "
        f"-1.450e-3 it is {coarse:.3f}. No reading of the text gives {printed}.",
        {"offset": float(found.mean()), "with the rounded gain": float(coarse)},
    )


def _offset_from(paper: Printed) -> Misprint:
    device = paper.nominal
    at_rest = np.full((1, 9), float(paper.numbers["sensor"]["rest_counts"]))
    jacobian = _core.jacobian(device.mechanism, at_rest, device.offsets, device.gains)
    rank = int(np.linalg.matrix_rank(jacobian[:, :9]))
    return Misprint(
        "nominal offset, before eq. (14)",
        "from (10)",
        "from (9)",
        f"At one pose (10) is {len(jacobian)} equations of rank {rank} in 9 offsets: it cannot "
        "give them. (9) solved for the offset is (14).",
        {"rank": float(rank)},
    )


def _table_vii(paper: Printed) -> Misprint:
    first = paper.sets["I"]
    off = {s: _rms(paper.sets[s].offsets - first.offsets) for s in ("II", "III")}
    gain = {s: _rms(paper.sets[s].gains - first.gains) * 1e3 for s in ("II", "III")}
    return Misprint(
        "Table VII, and the text about it",
        "rows I and II with 0.004, 0.005; 0.010, 0.024; “errors in Table VIII”",
        "rows II and III with 0.036 rad, 0.020e-3; 0.015 rad, 0.0064e-3; Table VII",
        "The printed rows are those of Table VI, and set I cannot differ from itself. From Tables "
        f"IV and V: II {off['II']:.3f} rad and {gain['II']:.4f}e-3, III {off['III']:.3f} rad and "
        f"{gain['III']:.4f}e-3.",
        {
            "offsets II, rad": off["II"],
            "offsets III, rad": off["III"],
            "gains II, 1e-3": gain["II"],
            "gains III, 1e-3": gain["III"],
        },
    )


def _jacobian(paper: Printed) -> Misprint:
    device = paper.sets["I"]
    smallest = {}
    for name, poses in (("II", paper.fixture), ("III", paper.closed_loop)):
        exact = device.readings(poses)
        values = []
        for a in exact.T:
            column = np.column_stack([np.ones(len(a)), a])
            scaled = column / np.linalg.norm(column, axis=0)
            values += np.linalg.svd(scaled, compute_uv=False).tolist()
        smallest[name] = min(values)
    return Misprint(
        "Table VIII, “Jacobian (13)”",
        "(13)",
        "(12)",
        "(13) is a line per joint: under it Table II would tell more than Table III (smallest "
        f"singular value {smallest['II']:.3f} against {smallest['III']:.3f}, unit columns). Table "
        "VIII has the opposite order, which is that of (12).",
        {"(13), Table II": smallest["II"], "(13), Table III": smallest["III"]},
    )


def _discussion(paper: Printed) -> Misprint:
    poses = {"II": len(paper.fixture), "III": len(paper.closed_loop)}
    return Misprint(
        "Discussion, “Tables III and IV”",
        "Tables III and IV",
        "Tables II and III",
        "The sentence is about pose data: Table IV holds 9 offsets and no pose, Tables II and III "
        f"{poses['II']} and {poses['III']} poses. (By reading, not by calculation.)",
        {"poses of Table II": float(poses["II"]), "poses of Table III": float(poses["III"])},
    )


def _table_ix(
    paper: Printed, averages: Mapping[str, float], trials: int, seed: int
) -> tuple[Misprint, ...]:
    printed = paper.numbers["noise"]["closed_average_2"]
    hundred = paper.numbers["noise"]["closed_average_100"]
    device, poses = paper.nominal, paper.closed_loop

    def found(noise: float, average: int, **how: Any) -> NoiseCell:
        many: dict[str, Any] = {"trials": trials, "seed": seed}
        return closed_loop_noise(device, poses, noise=noise, average=average, **many, **how)

    variance = [found(float(np.sqrt(v)), 2).offset.value for v in (1, 2, 4)]
    unrounded = found(1.0, 100, round_average=False).offset.value
    at_table = {s: found(s, 2, placement=(0.0, 0.0)) for s in (0, 1, 2, 4)}
    exact = {s: cell.offset.value for s, cell in at_table.items()}
    lost = sum(cell.failed for cell in at_table.values())
    level = {0: "truncation", 1: "1", 2: "2", 4: "4"}
    worse = [exact[s] / printed[level[s]][0] for s in exact]
    deviation = [averages[f"closed 2 {s}"] for s in (1, 2, 4)]
    rows = [averages[f"closed 100 {s}"] for s in (1, 2, 4)]
    truncation = averages["closed 2 0"]
    return (
        Misprint(
            "Table IX, “variance 1, 2, 4”",
            "variance",
            "standard deviation, in counts",
            "Printed errors double from row to row, "
            f"{_list([printed[str(s)][0] for s in (1, 2, 4)])}: so they do with these standard "
            f"deviations, {_list(deviation)}; with these variances they are {_list(variance)}.",
            {f"variance {v}": x for v, x in zip((1, 2, 4), variance, strict=True)},
        ),
        Misprint(
            "Table IX, averages of 100",
            "variance 1, 1, 1",
            "1, 2, 4",
            f"Standard deviations 1, 2, 4 give {_list(rows)}, the printed rows are "
            f"{_list([hundred[str(s)][0] for s in (1, 2, 4)])}.",
            {f"σ = {s}": x for s, x in zip((1, 2, 4), rows, strict=True)},
        ),
        Misprint(
            "Table IX, averages of 100",
            "(not said)",
            "the average is rounded again",
            f"Without that the error at σ = 1 is {unrounded:.4f} rad, far below the truncation row "
            f"({truncation:.4f}); printed {hundred['1'][0]}. Rounded again it is {rows[0]:.4f}.",
            {"not rounded": unrounded, "rounded": rows[0]},
        ),
        Misprint(
            "Table IX, poses",
            "“the poses of Table III”",
            "Table III as placed by hand: + N(0, 0.25) in and rad",
            f"Exactly at Table III errors are {_list([exact[s] for s in (0, 1, 2, 4)])} for "
            f"truncation, 1, 2, 4: {min(worse):.1f} to {max(worse):.1f} times the printed ones ("
            f"{lost} of {4 * trials} trials did not even come near the truth and are left out). "
            f"With the perturbation of section IV-B: {_list([truncation, *deviation])}.",
            {f"exact, σ = {s}": exact[s] for s in (0, 1, 2, 4)},
        ),
    )


def _list(values: list[float]) -> str:
    return ", ".join(f"{v:.3f}" for v in values)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
