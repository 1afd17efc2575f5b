"""Misprints in Tables I to VIII and in the text about them, each settled by a calculation."""

from __future__ import annotations

import numpy as np

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.reproduction.document import Misprint
from rsicalib.reproduction.kinematics import joint_angles, some_poses
from rsicalib.reproduction.printed import Printed
from rsicalib.reproduction.trials import rms


def table_i(paper: Printed) -> Misprint:
    """Head of the last column of Table I."""
    poses = some_poses(paper)
    mechanism = paper.nominal.mechanism
    chain = np.array([mechanism.inverse(pose.tolist()) for pose in poses])
    worst = float(np.abs(chain - joint_angles(poses)).max())
    return Misprint(
        "Table I, header",
        "a, s, a (rad)",
        "a, s, α (rad)",
        "The chain with the last column as twists α = π/2, 0, π/2, 0 reaches the same wrists as "
        f"eq. (2): joint angles of {len(poses)} poses agree to {worst:.0e} rad.",
        {"largest difference, rad": worst},
    )


def table_ii(paper: Printed) -> Misprint:
    """Height of pose 3 in Table II."""
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
    angles = joint_angles(np.array([[0.0, 0.0, z, 0.0, 0.0, 0.0]]))[0, :3]
    out: FloatArray = angles - paper.nominal.gains[0] * paper.numbers["sensor"]["rest_counts"]
    return out


def offset_3(paper: Printed) -> Misprint:
    """Nominal offset of joint 3."""
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


def offset_from(paper: Printed) -> Misprint:
    """Number of the equation that gives the nominal offset."""
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


def table_vii(paper: Printed) -> Misprint:
    """Rows and figures of Table VII."""
    first = paper.sets["I"]
    off = {s: rms(paper.sets[s].offsets - first.offsets) for s in ("II", "III")}
    gain = {s: rms(paper.sets[s].gains - first.gains) * 1e3 for s in ("II", "III")}
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


def jacobian(paper: Printed) -> Misprint:
    """Number of the Jacobian in the head of Table VIII."""
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


def discussion(paper: Printed) -> Misprint:
    """Numbers of the tables in the Discussion."""
    poses = {"II": len(paper.fixture), "III": len(paper.closed_loop)}
    return Misprint(
        "Discussion, “Tables III and IV”",
        "Tables III and IV",
        "Tables II and III",
        "The sentence is about pose data: Table IV holds 9 offsets and no pose, Tables II and III "
        f"{poses['II']} and {poses['III']} poses. (By reading, not by calculation.)",
        {"poses of Table II": float(poses["II"]), "poses of Table III": float(poses["III"])},
    )
