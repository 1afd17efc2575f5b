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
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsicalib._core import Channel, Mechanism, Term, __version__
    from rsicalib.api import (
        DEMO,
        calibrate,
        demo,
        fixture,
        forward,
        forward_sd,
        inverse,
        load_mechanism,
        load_readings,
        terms,
        trace,
    )
    from rsicalib.errors import (
        InputError,
        OpenLoopsWarning,
        RsicalibError,
        UndeterminedError,
        Where,
    )
    from rsicalib.exports.opening import export_result
    from rsicalib.facts.shapes import Parameter, Skipped, Step
    from rsicalib.facts.warned import Warned
    from rsicalib.fleets.devices import calibrate_devices
    from rsicalib.fleets.run import Fleet, fleet
    from rsicalib.imports.log import Log
    from rsicalib.imports.opening import import_log
    from rsicalib.io.readings import Readings
    from rsicalib.planning.identifiability import Counted, Identifiable, identifiable
    from rsicalib.planning.measures import Observability, observability
    from rsicalib.planning.plan import plan
    from rsicalib.planning.plans import Plan
    from rsicalib.planning.platform_sd import Workspace, workspace
    from rsicalib.planning.supposing import Supposition, suppose
    from rsicalib.poses.devices import Device
    from rsicalib.poses.placing import Placer
    from rsicalib.poses.simulation import Simulated, simulate
    from rsicalib.report.figure import Figure
    from rsicalib.report.past import History
    from rsicalib.reproduction.document import Paper
    from rsicalib.reproduction.paper import paper
    from rsicalib.results.certificate import Certificate
    from rsicalib.results.result import Calibration, Trace, load_calibration
    from rsicalib.verbs.certifying import certify
    from rsicalib.verbs.devices import WatchingDevices, watch_devices
    from rsicalib.verbs.export import export_toml, export_urdf
    from rsicalib.verbs.lifetime import history
    from rsicalib.verbs.monitor import Alarm, Monitor, Watch, Watching, watch

__all__ = [
    "DEMO",
    "Alarm",
    "Calibration",
    "Certificate",
    "Channel",
    "Counted",
    "Device",
    "Figure",
    "Fleet",
    "History",
    "Identifiable",
    "InputError",
    "Log",
    "Mechanism",
    "Monitor",
    "Observability",
    "OpenLoopsWarning",
    "Paper",
    "Parameter",
    "Placer",
    "Plan",
    "Readings",
    "RsicalibError",
    "Simulated",
    "Skipped",
    "Step",
    "Supposition",
    "Term",
    "Trace",
    "UndeterminedError",
    "Warned",
    "Watch",
    "Watching",
    "WatchingDevices",
    "Where",
    "Workspace",
    "__version__",
    "calibrate",
    "calibrate_devices",
    "certify",
    "demo",
    "export_result",
    "export_toml",
    "export_urdf",
    "fixture",
    "fleet",
    "forward",
    "forward_sd",
    "history",
    "identifiable",
    "import_log",
    "inverse",
    "load_calibration",
    "load_mechanism",
    "load_readings",
    "observability",
    "paper",
    "plan",
    "simulate",
    "suppose",
    "terms",
    "trace",
    "watch",
    "watch_devices",
    "workspace",
]

_HOMES = {
    "rsicalib._core": "Channel Mechanism Term __version__",
    "rsicalib.api": """DEMO calibrate demo fixture forward forward_sd inverse load_mechanism
        load_readings terms trace""",
    "rsicalib.results.certificate": "Certificate",
    "rsicalib.verbs.certifying": "certify",
    "rsicalib.poses.devices": "Device",
    "rsicalib.errors": "InputError OpenLoopsWarning RsicalibError UndeterminedError Where",
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
"""Names by the module that has them; a module is imported where its first name is used."""

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        for module, names in _HOMES.items():
            if name in names.split():
                value = globals()[name] = getattr(importlib.import_module(module), name)
                return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted(__all__)
