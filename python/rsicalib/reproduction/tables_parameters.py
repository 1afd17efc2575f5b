"""Tables IV to VII: the calibrated parameters, and what they are worth on known poses."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rsicalib.reproduction.document import Cell, Row, Table
from rsicalib.reproduction.section_iv import BOTH, CLOSED, OPEN, Trials
from rsicalib.reproduction.study import NOISE, Study, pose_errors
from rsicalib.reproduction.trials import rms

JOINTS = tuple(f"{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))


def parameters(
    study: Study, table: str, title: str, what: str, calibrations: Mapping[str, Trials]
) -> Table:
    """Tables IV and V: offsets or gains of the three sets, with their scatter."""
    scale = 1.0 if what == "offsets" else 1e3
    spread = {
        name: getattr(calibrations[label], what).std(axis=0, ddof=1) * scale
        for name, label in (("I", OPEN), ("II", CLOSED), ("III", BOTH))
    }
    values = {name: getattr(d, what) * scale for name, d in study.printed.sets.items()}
    rows = []
    for k, joint in enumerate(JOINTS):
        cells = [Cell(None, float(values[name][k])) for name in values]
        cells += [Cell(float(spread[name][k])) for name in spread]
        rows.append(Row(f"{'θ' if what == 'offsets' else 'k'}{joint}", tuple(cells)))
    off = {
        name: rms((values[name] - values["I"]) / np.hypot(spread[name], spread["I"]))
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


def table_vi(study: Study) -> Table:
    """Table VI: errors on the poses of the fixture."""
    printed = study.numbers["accuracy"]
    exact = study.device.readings(study.printed.fixture)
    own = printed["I"]
    rows = [Row("I", tuple(Cell(None, p) for p in own))]
    alone = {}
    for name in ("II", "III"):
        device = study.printed.sets[name]
        errors = pose_errors(device.offsets, device.gains, exact, study.printed.fixture)
        alone[name] = errors
        cells = (
            Cell(math.hypot(e, r), p) for e, r, p in zip(errors, own, printed[name], strict=True)
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


def table_vii(study: Study) -> Table:
    """Table VII: differences from set I."""
    first = study.device
    rows = []
    for name in ("II", "III"):
        device, p = study.printed.sets[name], study.numbers["against_I"][name]
        off, gain = rms(device.offsets - first.offsets), rms(device.gains - first.gains) * 1e3
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
