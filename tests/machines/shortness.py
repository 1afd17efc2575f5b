"""On what the shortness of a Maslow's lower belts depends: found here, held against others.

`python -m tests.machines.shortness FOLDER` adds `k f` to the readings of both lower belts of every
session of a folder, for functions `f` of the lengths of belts: `k` is what lowers χ² most in the
ten power cycles `ten_*`, and the other sessions are calibrated with that `k`, which they have had
no part in.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from rsicalib import Mechanism, Readings, calibrate
from tests.oracle import Array

HELD = ("frame_a", "frame_b", "show")
"""Sessions that take no part in finding `k`."""
FULL = 2000.0
"""Belts of this length [mm] have `f = 1`, all of them."""
MOST = 40.0
"""Bound of `k` [mm]."""

FORMS: dict[str, Callable[[Array, Array], Array]] = {
    "a constant": lambda low, up: np.ones_like(low),
    "square root of the length": lambda low, up: np.sqrt(low),
    "length": lambda low, up: low,
    "square of the length": lambda low, up: np.square(low),
    "cube of the length": lambda low, up: np.power(low, 3),
    "length times that of the belt above": lambda low, up: np.asarray(low * up),
    "length over that of the belt above": lambda low, up: np.asarray(low / up),
    "length of the belt above": lambda low, up: up,
    "length of the other upper belt": lambda low, up: up[:, ::-1],
    "length of the other lower belt": lambda low, up: low[:, ::-1],
}
"""Of the lower belts' lengths and of those above, left and right, in two metres."""


class Session:
    """The readings of one session."""

    def __init__(self, file: Path, mechanism: Mechanism) -> None:
        """From a file."""
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        self.mechanism = mechanism
        self.pose, self.lengths = rows[:, 0].astype(int), rows[:, 2:]
        self.name = file.stem

    def fitted(self, form: str, k: float) -> tuple[float, float, float]:
        """χ², degrees of freedom and misclosure [mm] where the lower belts are longer by `k f`."""
        lengths = self.lengths.copy()
        low, up = self.lengths[:, 2:] / FULL, self.lengths[:, :2] / FULL
        lengths[:, 2:] += k * FORMS[form](low, up)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            readings = Readings.from_arrays(self.mechanism, lengths, pose=self.pose)
            fit = calibrate(readings, self.mechanism).fit
        assert fit.chi2 is not None and fit.dof is not None and fit.rms_misclosure is not None
        return fit.chi2, fit.dof, fit.rms_misclosure


def best(sessions: Sequence[Session], form: str) -> tuple[float, float]:
    """`k` and its standard deviation, from where χ² rises by one in all of them together."""

    def chi2(k: float) -> float:
        return sum(session.fitted(form, k)[0] for session in sessions)

    found = minimize_scalar(chi2, bounds=(-MOST, MOST), method="bounded", options={"xatol": 0.05})
    k, step = float(found.x), 1.0
    bend = chi2(k + step) + chi2(k - step) - 2 * float(found.fun)
    return k, float(np.sqrt(2 * step**2 / bend)) if bend > 0 else float("inf")


def main(arguments: Sequence[str]) -> None:
    """The command."""
    folder = Path(arguments[0])
    mechanism = Mechanism.from_toml((folder / "maslow.toml").read_text())
    ten = [Session(file, mechanism) for file in sorted(folder.glob("ten_*.csv"))]
    held = [Session(folder / f"{name}.csv", mechanism) for name in HELD]

    def cells(form: str, k: float) -> str:
        found = [s.fitted(form, k) for s in ten]
        chi2, dof = (sum(f[i] for f in found) for i in (0, 1))
        own = [s.fitted(form, k) for s in held]
        out = [f"{chi2:.0f} / {dof:.0f}"]
        out += [f"{f[0]:.0f} / {f[1]:.0f}, {f[2]:.2f} mm" for f in own]
        return " | ".join(out)

    print(f"| lower belts longer by | k [mm] | ten_* | {' | '.join(HELD)} |")
    print("|---|---|---|---|---|---|")
    print(f"| nothing | | {cells('length', 0.0)} |", flush=True)
    for form in FORMS:
        k, sd = best(ten, form)
        print(f"| {form} | {k:.2f} ± {1.96 * sd:.2f} | {cells(form, k)} |", flush=True)
    each = [best([session], "length")[0] for session in ten]
    print(f"length, session by session: {', '.join(f'{k:.2f}' for k in each)} mm")


if __name__ == "__main__":
    main(sys.argv[1:])
