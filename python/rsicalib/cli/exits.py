"""What the command returns: the one list, for its help and its page."""

from __future__ import annotations

EXITS = {
    0: "usable: a calibration that is adequate, explained or unjudged; no alarm; within the limit",
    1: "a defect of rsicalib",
    2: "the input or the options cannot be used",
    3: "the data cannot determine what was asked, or whether an error is within the limit",
    4: "not to be relied on: a residual is left, a law that no term has is likelier than chance, "
    "or the result is implausible; an alarm; not within the limit",
    130: "interrupted (143 by SIGTERM, 129 by SIGHUP); no half-written file is left",
}
"""Meaning of each exit code, for calibrations, watches and certificates."""
