"""Write the files again."""

from __future__ import annotations

import datetime
import importlib
from typing import Any

import numpy as np

from tests.strangers.written import HERE, JOINTS, ROWS, START, angles, percents

polars: Any = importlib.import_module("polars")
duckdb: Any = importlib.import_module("duckdb")

begin = datetime.datetime.fromtimestamp(START, datetime.UTC)
times = [begin + datetime.timedelta(milliseconds=20 * k) for k in range(ROWS)]
columns = dict(zip(JOINTS, angles().T, strict=True))
frame = polars.DataFrame({"timestamp": times, "robot": ["r1"] * ROWS, **columns})
frame.write_parquet(HERE / "polars.parquet")

base = duckdb.connect()
base.execute(
    "CREATE TABLE rows(episode_index BIGINT, timestamp FLOAT, "
    'action FLOAT[3], "observation.state" FLOAT[3])'
)
for k, (leader, follower) in enumerate(zip(percents(0), percents(1), strict=True)):
    values = [k // 20, float(np.float32(k % 20 / 30)), leader.tolist(), follower.tolist()]
    base.execute("INSERT INTO rows VALUES (?, ?, ?, ?)", values)
base.execute(f"COPY rows TO '{HERE / 'duckdb.parquet'}' (FORMAT parquet, COMPRESSION zstd)")
