"""Processes that are forked from one that has computed already: every verb works in them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")

VERBS = """
import os, signal, sys
import rsicalib
from rsicalib import DEMO

def no_longer_than_minutes():
    signal.alarm(240)  # ends a process that waits for ever; a child does not inherit it

no_longer_than_minutes()
os.register_at_fork(after_in_child=no_longer_than_minutes)

def verbs():
    made = rsicalib.simulate(poses=20, samples=3, seed=3)
    values = made.readings.values
    fit = rsicalib.calibrate(made.readings, rest=made.rest, check=DEMO / "check.csv")
    traced = rsicalib.trace(made.readings, rest=made.rest)
    plan = rsicalib.plan(poses=9, candidates=60, starts=2, seed=1)
    more = rsicalib.plan(poses=1, candidates=60, result=traced, beside=made.readings)
    parts = [traced.evidence, fit.evidence, rsicalib.forward(made.readings, calibration=fit)]
    parts += [rsicalib.forward_sd(made.readings, "rsi", fit)]
    parts += [rsicalib.observability(made.readings)]
    parts += [rsicalib.identifiable(), rsicalib.workspace(fit, poses=20)]
    parts += [rsicalib.fixture(DEMO / "check.csv")]
    parts += [rsicalib.suppose(made.readings, ["curvature@a22.c2=0.02"])]
    parts += [rsicalib.watch(made.readings, fit)]
    return repr((fit.to_dict(), traced.to_dict(), plan.csv(), more.csv(), parts))
"""

OWN_THREADS = """
def strangers():
    names = []
    for task in os.listdir("/proc/self/task"):
        with open(f"/proc/self/task/{task}/comm") as file:
            names.append(file.read().strip())
    return [n for n in names if not n.startswith("rsicalib-")]
"""


def run(program: str) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", program],
        capture_output=True,
        text=True,
        timeout=500,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_a_child_of_a_child_computes_what_its_grandparent_does() -> None:
    fork = """
expected = verbs()
for generation in range(2):
    child = os.fork()
    if child:
        sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    assert verbs() == expected
    # Only the thread that was forked, and those of the core's own pool: no copy of a pool.
    if os.path.isdir("/proc/self/task"):
        assert len(strangers()) == 1, strangers()
"""
    run(VERBS + OWN_THREADS + fork)


def test_a_pool_of_forked_workers_calibrates() -> None:
    pool = """
import multiprocessing

def chi2(seed):
    made = rsicalib.simulate(poses=14, samples=2, seed=seed)
    return rsicalib.calibrate(made.readings, rest=made.rest).fit.chi2

expected = [chi2(seed) for seed in range(4)]
with multiprocessing.get_context("fork").Pool(2) as pool:
    assert pool.map(chi2, range(4)) == expected
"""
    run(VERBS + pool)
