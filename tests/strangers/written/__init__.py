"""Parquet by libraries that share no code with the reader: `python -m tests.strangers.written`.

The files beside this one were written by Polars 2.1 and DuckDB 2.0 (`pip install polars duckdb`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.oracle import Array

HERE = Path(__file__).parent
START = 1_700_000_000
ROWS, JOINTS = 40, ("pan", "lift", "elbow")


def angles() -> Array:
    """Joints that move for 0.4 s at 50 Hz, and stand still then, shape (40, 3) [rad]."""
    t = np.minimum(np.arange(ROWS), 20)[:, None] / 50
    return np.round(np.sin(3 * t + np.arange(3)), 6)


def percents(side: int) -> Array:
    """A leader (0) or its follower (1), in steps of a range of 2000, shape (40, 3)."""
    t = np.arange(ROWS)[:, None] - 3 * side
    return np.float32(np.rint(600 * np.sin(0.2 * t + np.arange(3))) / 10).astype(float)
