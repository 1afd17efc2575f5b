"""Misprints in the equations, each settled by a calculation.

Every function evaluates what is printed and what it should be, and says in numbers which of the
two holds.
"""

from __future__ import annotations

import numpy as np

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.reproduction.document import Misprint
from rsicalib.reproduction.kinematics import in_arms, joint_angles, plane, some_poses, turn, wrists
from rsicalib.reproduction.noise import fixture_lines
from rsicalib.reproduction.printed import Printed


def eq_4(paper: Printed) -> Misprint:
    """Sign within eq. (4)."""
    r = wrists(paper, some_poses(paper))
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


def eq_5(paper: Printed) -> Misprint:
    """Order and sign of the angles in eq. (5)."""
    poses = some_poses(paper)
    x, y, z = np.moveaxis(turn(poses), 2, 0)
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


def ranges(paper: Printed) -> Misprint:
    """Ranges of the joints in section II-B."""
    angles = joint_angles(np.vstack([paper.fixture, paper.closed_loop])).reshape(-1, 3, 3)
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


def eq_8(paper: Printed) -> Misprint:
    """Signs in eq. (8)."""
    g = paper.numbers["geometry"]
    r = in_arms(paper, wrists(paper, some_poses(paper)))
    t3 = np.arcsin(r[..., 2] / g["l3"])
    reach, rho = g["l3"] * np.cos(t3), np.hypot(r[..., 0], r[..., 1])
    t2 = -np.arccos((rho**2 - g["l2"] ** 2 - reach**2) / (2 * g["l2"] * reach))
    inner = np.arccos((rho**2 + g["l2"] ** 2 - reach**2) / (2 * g["l2"] * rho))
    error = {}
    for sign in (-1, 1):
        t1 = np.arctan2(r[..., 1], r[..., 0]) + sign * inner
        back = plane(paper, np.stack([t1, t2, t3], axis=-1))
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


def eq_12(paper: Printed) -> Misprint:
    """Unknowns in eq. (12)."""
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


def eq_13(paper: Printed) -> Misprint:
    """Sign of the offset in eq. (13)."""
    device = paper.sets["I"]
    exact = device.readings(paper.fixture)
    angles = joint_angles(paper.fixture)
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
