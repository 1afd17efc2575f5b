"""The command `rsicalib`: one verb per job.

Results go to standard output, progress and warnings to standard error. What a
verb returns is what it exits with:

    0    a usable calibration: adequate, or explained after tracing
    1    a defect of ours
    2    the input or the options cannot be used
    3    the data cannot determine what was asked
    4    a calibration was found, but the residual is significant
    130  interrupted; 143 by SIGTERM, 129 by SIGHUP
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import NoReturn


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command and leave; Ctrl-C is heard while modules are still imported, too.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments; those of the process where not given.
    """
    try:
        from rsicalib.cli.command import main as run

        run(argv)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr, flush=True)
        os._exit(130)
