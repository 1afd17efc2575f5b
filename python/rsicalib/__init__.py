"""Calibration of closed kinematic chains from their own joint readings.

>>> import rsicalib
>>> found = rsicalib.trace(
...     rsicalib.DEMO / "readings.csv",
...     rest=rsicalib.DEMO / "rest.csv",
...     check=rsicalib.DEMO / "check.csv",
... )
>>> found.verdict
'explained'
"""

from __future__ import annotations

import importlib

_HOMES = {
    "rsicalib._core": "Channel Mechanism Term __version__",
    "rsicalib.api": "DEMO demo load_mechanism load_readings terms",
    "rsicalib.verbs.calibration": "calibrate",
    "rsicalib.verbs.open_loop": "fixture",
    "rsicalib.verbs.tracing": "trace",
    "rsicalib.poses.kinematics": "forward forward_sd inverse",
    "rsicalib.results.certificate": "Certificate",
    "rsicalib.verbs.certifying": "certify",
    "rsicalib.poses.devices": "Device",
    "rsicalib.errors": (
        "InputError InputTypeError OpenLoopsWarning RsicalibError UndeterminedError Where"
    ),
    "rsicalib.verbs.export": "export_toml export_urdf",
    "rsicalib.exports.opening": "export_result",
    "rsicalib.fleets.devices": "calibrate_devices",
    "rsicalib.fleets.run": "Fleet fleet",
    "rsicalib.planning.identifiability": "Counted Identifiable identifiable",
    "rsicalib.imports.log": "Log",
    "rsicalib.imports.opening": "import_log",
    "rsicalib.io.readings": "Readings",
    "rsicalib.verbs.lifetime": "history",
    "rsicalib.planning.measures": "Observability observability",
    "rsicalib.verbs.devices": "WatchingDevices watch_devices",
    "rsicalib.verbs.monitor": "Alarm Monitor Watch Watching watch",
    "rsicalib.poses.placing": "Placer",
    "rsicalib.planning.plan": "plan",
    "rsicalib.planning.plans": "Plan",
    "rsicalib.planning.platform_sd": "Workspace workspace",
    "rsicalib.report.figure": "Figure",
    "rsicalib.report.past": "History",
    "rsicalib.reproduction.document": "Paper",
    "rsicalib.reproduction.paper": "paper",
    "rsicalib.results.result": "Calibration Trace load_calibration",
    "rsicalib.facts.shapes": "Parameter Skipped Step",
    "rsicalib.poses.simulation": "Simulated simulate",
    "rsicalib.planning.supposing": "Supposition suppose",
    "rsicalib.facts.warned": "Warned",
}
"""Names by the module that has them; a module is imported where its first name is used.

Type checkers have them from `__init__.pyi`, which `python -m scripts.make_stub` writes.
"""

__all__ = sorted(name for names in _HOMES.values() for name in names.split())


def __getattr__(name: str) -> object:
    for module, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(importlib.import_module(module), name)
            return value
    if f"{__name__}.{name}" in _HOMES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
