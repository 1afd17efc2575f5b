"""The paper's problem (11): rsicalib beside SciPy's MINPACK, in one run on one machine.

`python benches/speed.py` from the root of the repository. The rival is
`scipy.optimize.least_squares(method="lm")` with the analytic Jacobian in numpy, vectorised over
poses and arms. Both start from the nominal parameters; before anything is timed, both must reach
the same minimum to 1e-9 of the size of each parameter, and the rival's kinematics must agree with
`tests/oracle.py`.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

if __name__ == "__main__":  # one thread, for both; before numpy is loaded
    for _name in ("OMP", "OPENBLAS", "MKL", "RAYON"):
        os.environ[f"{_name}_NUM_THREADS"] = "1"
    sys.path[0] = str(Path(__file__).parent.parent)  # not benches: a file there may hide a module

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from rsicalib import _core
from tests import oracle
from tests.oracle import Array

PAIRS = ((0, 1), (1, 2), (0, 2))
XTOL = 1e-10


class Rival:
    """Misclosure and Jacobian of the hand controller in numpy: (9), (2), (10), (12).

    Positions and derivatives of all wrists of all poses are a handful of array operations; nothing
    is computed twice for the two, since MINPACK asks for both at almost every point.
    """

    def __init__(self, counts: Array) -> None:
        self.counts = counts
        self.d2 = 3 * oracle.L4**2
        cos, sin = np.cos(oracle.BASE_ANGLES), np.sin(oracle.BASE_ANGLES)
        zero = np.zeros(3)
        # base_from_shoulder of the three arms: Rz(θ0) Rx(π/2), and its origin.
        self.turn = np.array([[cos, zero, sin], [sin, zero, -cos], [zero, zero + 1, zero]])
        self.turn = self.turn.transpose(2, 0, 1)
        self.origin = oracle.L1 * np.stack([cos, sin, zero], axis=1)
        self.at: Array | None = None
        # Sign of wrist w in the difference of pair k, times 2.
        self.sign = np.zeros((3, 3))
        for k, (a, b) in enumerate(PAIRS):
            self.sign[k, a], self.sign[k, b] = 2.0, -2.0
        self.first, self.second = np.array(PAIRS).T

    def _visit(self, x: Array) -> None:
        if self.at is not None and np.array_equal(self.at, x):
            return
        self.at = x.copy()
        angles = (self.counts * x[9:] + x[:9]).reshape(-1, 3, 3)
        t1, t3 = angles[..., 0], angles[..., 2]
        t12 = t1 + angles[..., 1]
        c1, s1, c12, s12 = np.cos(t1), np.sin(t1), np.cos(t12), np.sin(t12)
        c3, s3 = oracle.L3 * np.cos(t3), oracle.L3 * np.sin(t3)
        x2, y2 = c12 * c3, s12 * c3
        x1, y1 = oracle.L2 * c1 + x2, oracle.L2 * s1 + y2
        zero = np.zeros_like(t1)
        # Columns: the wrist, and its derivatives by the three joints, in the shoulder frame.
        local = np.stack(
            [x1, -y1, -y2, -c12 * s3, y1, x1, x2, -s12 * s3, s3, zero, zero, c3], axis=-1
        ).reshape(*t1.shape, 3, 4)
        base = self.turn @ local
        wrist = base[..., 0] + self.origin
        apart = wrist[:, self.first] - wrist[:, self.second]
        self.f = (np.einsum("pki,pki->pk", apart, apart) - self.d2).ravel()
        by_angle = np.einsum("pki,pwij,kw->pkwj", apart, base[..., 1:], self.sign, optimize=False)
        by_offset = by_angle.reshape(-1, 3, 9)
        by_gain = by_offset * self.counts[:, None, :]
        self.jacobian = np.concatenate([by_offset, by_gain], axis=2).reshape(-1, 18)

    def fun(self, x: Array) -> Array:
        """Misclosure: shape (3 n,)."""
        self._visit(x)
        return self.f

    def jac(self, x: Array) -> Array:
        """Its derivatives by offsets and gains: shape (3 n, 18)."""
        self._visit(x)
        return self.jacobian


class Plain:
    """The same as one would write it down: residual and Jacobian apart, arm by arm."""

    def __init__(self, counts: Array) -> None:
        self.counts = counts

    def _arm(self, i: int, x: Array) -> tuple[Array, Array]:
        """Wrist i (n, 3), and its derivatives by the three joints (n, 3, 3)."""
        own = slice(3 * i, 3 * i + 3)
        t1, t2, t3 = (self.counts[:, own] * x[9:][own] + x[:9][own]).T
        reach, zero = oracle.L3 * np.cos(t3), np.zeros(len(t1))
        u = oracle.L2 * np.cos(t1) + reach * np.cos(t1 + t2)
        v = oracle.L2 * np.sin(t1) + reach * np.sin(t1 + t2)
        u3 = -oracle.L3 * np.cos(t1 + t2) * np.sin(t3)
        v3 = -oracle.L3 * np.sin(t1 + t2) * np.sin(t3)
        by1 = np.stack([-v, u, zero], axis=1)
        by2 = np.stack([-reach * np.sin(t1 + t2), reach * np.cos(t1 + t2), zero], axis=1)
        by3 = np.stack([u3, v3, oracle.L3 * np.cos(t3)], axis=1)
        frame = oracle.dh(oracle.BASE_ANGLES[i], 0.0, oracle.L1, np.pi / 2)
        r = np.stack([u, v, oracle.L3 * np.sin(t3)], axis=1) @ frame[:3, :3].T + frame[:3, 3]
        return r, np.stack([by1, by2, by3], axis=1) @ frame[:3, :3].T

    def fun(self, x: Array) -> Array:
        """Misclosure: shape (3 n,)."""
        r = [self._arm(i, x)[0] for i in range(3)]
        f = [np.sum((r[a] - r[b]) ** 2, axis=1) - 3 * oracle.L4**2 for a, b in PAIRS]
        return np.stack(f, axis=1).ravel()

    def jac(self, x: Array) -> Array:
        """Its derivatives by offsets and gains: shape (3 n, 18)."""
        arms = [self._arm(i, x) for i in range(3)]
        out = np.zeros((len(self.counts), 3, 18))
        for k, (a, b) in enumerate(PAIRS):
            apart = arms[a][0] - arms[b][0]
            for i, sign in ((a, 2.0), (b, -2.0)):
                own = sign * np.einsum("pji,pi->pj", arms[i][1], apart)
                out[:, k, 3 * i : 3 * i + 3] = own
                out[:, k, 9 + 3 * i : 12 + 3 * i] = own * self.counts[:, 3 * i : 3 * i + 3]
        return out.reshape(-1, 18)


def session(poses: int, seed: int = 1) -> tuple[Array, Array]:
    """Counts of wide hand-held poses of a device a few per cent off nominal, and the start."""
    rng = np.random.default_rng(seed)
    mechanism = oracle.rsi()
    nominal = np.concatenate(oracle.nominal(mechanism))
    truth = nominal + np.concatenate([rng.normal(0, 0.04, 9), rng.normal(0, 3e-5, 9)])
    kept: list[Array] = []
    while len(kept) < poses:
        half = np.array([2.5, 2.5, 2.1, 0.52, 0.52, 0.52])
        pose = rng.uniform(-half, half, (2 * poses + 20, 6)) + [0, 0, -2.9, 0, 0, 0]
        angles = oracle.rsi_inverse(pose).reshape(-1, 9)
        counts = np.round((angles - truth[:9]) / truth[9:] + rng.normal(0, 1, angles.shape))
        good = np.all(np.isfinite(counts) & (counts >= 0) & (counts <= 4095), axis=1)
        kept += list(counts[good])
    return np.array(kept[:poses]), nominal


def best(call: Callable[[], object], seconds: float) -> float:
    """Shortest of as many calls as fit into the time [s]."""
    times: list[float] = []
    end = time.perf_counter() + seconds
    while not times or time.perf_counter() < end:
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def compare(poses: int, seconds: float) -> None:
    """Time all three on a session of so many poses, and print a line for each rival."""
    counts, start = session(poses)
    f = oracle.misclosure(oracle.rsi(), start[:9], start[9:], counts).ravel()
    np.testing.assert_allclose(Rival(counts).fun(start), f, atol=1e-11)
    np.testing.assert_allclose(Plain(counts).fun(start), f, atol=1e-11)
    np.testing.assert_allclose(Plain(counts).jac(start), Rival(counts).jac(start), atol=1e-8)
    mechanism = _core.Mechanism.rsi()

    def ours() -> tuple[Array, Array, float, int, str]:
        return _core.minimize(mechanism, counts, start[:9], start[9:], xtol=XTOL)

    def scipy(rival: type[Rival] | type[Plain], tol: float = 1e-15) -> OptimizeResult:
        made = rival(counts)
        return least_squares(
            made.fun, start, made.jac, method="lm", x_scale="jac", xtol=XTOL, ftol=tol, gtol=tol
        )

    # SciPy's own ftol of 1e-8 stops it 5e-8 before the minimum; 1e-15 leaves it to xtol.
    offsets, gains, _, iterations, _ = ours()
    there = scipy(Rival)
    np.testing.assert_allclose(np.concatenate([offsets, gains]), there.x, rtol=1e-9)
    fast = best(ours, seconds)
    print(f"{poses} poses: rsicalib {fast * 1e6:.1f} µs, {iterations} linearisations")
    for words, call in (
        ("residual and Jacobian apart, arm by arm", lambda: scipy(Plain)),
        ("tuned: vectorised over arms, computed once for both", lambda: scipy(Rival)),
        ("tuned, stopped 5e-8 early by its default ftol", lambda: scipy(Rival, 1e-8)),
    ):
        slow = best(call, seconds)
        print(f"  SciPy {slow * 1e6:9.1f} µs, {slow / fast:6.1f} times as long   ({words})")


def main() -> None:
    """Compare on 12 and on 2000 poses."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2.0, help="for each of the two, per size")
    parser.add_argument("--poses", type=int, nargs="*", default=[12, 2000])
    options = parser.parse_args()
    for poses in options.poses:
        compare(poses, options.seconds)


if __name__ == "__main__":
    main()
