"""The client of a fleet over a cluster: its processor time, and its memory.

`python -m tests.fleet_scale time` calibrates devices on a local cluster, whose workers and
scheduler run in other processes, and prints the client's processor time beside theirs. With `memory
--devices 100000` workers make rows up, which costs them nothing: what the client reads, keeps, sums
up and draws is that of a fleet of so many, and its memory is printed.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rsicalib
from rsicalib.fleets import run as running
from rsicalib.fleets.dataset import Partition
from rsicalib.fleets.engines import Job
from rsicalib.fleets.frames import Rows

CLUSTER = """
import sys, distributed
if __name__ == "__main__":
    made = distributed.LocalCluster(n_workers=int(sys.argv[1]), threads_per_worker=1,
                                    dashboard_address=None, silence_logs=50)
    print(made.scheduler_address, flush=True)
    sys.stdin.read()
"""


class MadeUp(Job):
    """Rows as a calibration has them, of numbers that are drawn."""

    def __call__(self, partition: Partition) -> Rows:
        """Rows of the devices of a partition."""
        labels = partition.labels
        rng = np.random.default_rng(len(labels))
        draw = lambda: rng.standard_normal(len(labels)).tolist()  # noqa: E731
        rows: dict[str, Any] = {self.by: labels, "poses": [24] * len(labels)}
        rows |= {"samples": [96] * len(labels), "verdict": ["adequate"] * len(labels)}
        rows |= {"message": [""] * len(labels), "dof": [54.0] * len(labels)}
        rows |= {"chi2": [54.0] * len(labels), "p_value": rng.random(len(labels)).tolist()}
        for term in ("offset", "gain"):
            for channel in self.mechanism.channels:
                rows[f"{term}@{channel.name}"] = draw()
                rows[f"{term}@{channel.name}_sd"] = [1.0] * len(labels)
        rows |= {"steps": ["[]"] * len(labels), "sha256": ["0" * 64] * len(labels)}
        return rows

    def refuse(self, refused: Mapping[Any, str]) -> Rows:
        """Rows of devices without a result."""
        return {self.by: list(refused), "message": list(refused.values())} if refused else {}


def dataset(path: Path, devices: int, made: Sequence[Any]) -> None:
    """A Parquet file of devices, sorted, a thousand in a row group; sessions come again."""
    import pyarrow as pa
    from pyarrow import parquet

    names = [channel.name for channel in rsicalib.load_mechanism("rsi").channels]
    writer = None
    for start in range(0, devices, 1000):
        own = [made[k % len(made)].readings for k in range(start, min(start + 1000, devices))]
        label = np.repeat([f"d{start + k:07}" for k in range(len(own))], [len(r) for r in own])
        columns: dict[str, Any] = {"device": label, "pose": np.concatenate([r.pose for r in own])}
        values = np.concatenate([r.values for r in own])
        columns |= {name: values[:, k] for k, name in enumerate(names)}
        table = pa.table(columns)
        writer = writer or parquet.ParquetWriter(path, table.schema)
        writer.write_table(table)
    if writer is not None:
        writer.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("time", "memory"))
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--poses", type=int, default=24)
    parser.add_argument("--samples", type=int, default=4)
    args = parser.parse_args(arguments)
    import distributed

    if args.what == "memory":
        running.Job = MadeUp  # type: ignore[misc]
        args.poses, args.samples = 1, 2
    made = [
        rsicalib.simulate(poses=args.poses, samples=args.samples, check=1, seed=seed)
        for seed in range(20)
    ]
    words = [sys.executable, "-c", CLUSTER, str(args.workers)]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as run,
    ):
        assert run.stdout is not None and run.stdin is not None
        address = run.stdout.readline().strip()
        path = Path(folder) / "fleet.parquet"
        dataset(path, args.devices, made)
        with distributed.Client(address) as client:
            before = sum(client.run(time.process_time).values())
            here = time.process_time()
            found = rsicalib.fleet(path, out=Path(folder) / "out", dask=address, trace=False)
            here = time.process_time() - here
            there = sum(client.run(time.process_time).values()) - before
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            f"{len(found)} devices: {here:.2f} s of the client, {there:.2f} s of the workers "
            f"({100 * here / there:.1f} %), {most:.0f} MB of the client"
        )
        run.stdin.close()


if __name__ == "__main__":
    main()
