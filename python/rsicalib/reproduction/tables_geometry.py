"""Tables I to III: the geometry, and the poses through inverse and forward kinematics."""

from __future__ import annotations

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.reproduction.document import Cell, Row, Table
from rsicalib.reproduction.study import Study

POSE = ("x", "y", "z", "θx", "θy", "θz")


def table_i(study: Study) -> Table:
    """Table I: constants of the arms."""
    g = study.numbers["geometry"]
    plain = study.mechanism.to_dict()
    printed = {"a": (g["l1"], g["l2"], 0.0, 0.0), "d": (0.0,) * 4, "alpha": g["alpha"]}
    rows = [
        Row(
            f"j = {j}",
            tuple(Cell(row.get(key, 0.0), of[j]) for key, of in printed.items()),
        )
        for j, row in enumerate(plain["chain"][0]["dh"])
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


def poses(study: Study, table: str, title: str, poses: FloatArray) -> Table:
    """Tables II and III: poses turned into joint angles and back."""
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


def _near(value: float) -> float:
    """A figure without the rounding of a round trip."""
    return round(value, 9) + 0.0
