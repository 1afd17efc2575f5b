"""The command `rsicalib`: one verb per job.

Results go to standard output, progress and warnings to standard error. What a
verb returns is what it exits with:

    0    a usable calibration: adequate, or explained after tracing
    1    a defect of ours
    2    the input or the options cannot be used
    3    the data cannot determine what was asked
    4    a calibration was found, but the residual is significant
    130  interrupted
"""

from rsicalib.cli.command import main

__all__ = ["main"]
