"""The command `rsicalib`: one verb per job.

Results go to standard output, progress and warnings to standard error. What a verb returns is what
it exits with (`rsicalib.cli.exits`).
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
