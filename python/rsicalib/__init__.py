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
    from rsicalib.certificates import Certificate
    from rsicalib.certifying import certify
    from rsicalib.devices import Device
    from rsicalib.errors import InputError, OpenLoopsWarning, RsicalibError, UndeterminedError
    from rsicalib.export import export_toml, export_urdf
    from rsicalib.exports.opening import export_result
    from rsicalib.fleets.devices import calibrate_devices
    from rsicalib.fleets.run import Fleet, fleet
    from rsicalib.identifiability import Identifiable, identifiable
    from rsicalib.imports.log import Log
    from rsicalib.imports.opening import import_log
    from rsicalib.io.readings import Readings
    from rsicalib.lifetime import history
    from rsicalib.measures import Observability, observability
    from rsicalib.monitor import Alarm, Monitor, Watch, Watching, watch
    from rsicalib.placing import Placer
    from rsicalib.planning import plan
    from rsicalib.plans import Plan
    from rsicalib.platform_sd import Workspace, workspace
    from rsicalib.report.past import History
    from rsicalib.reproduction.document import Paper
    from rsicalib.reproduction.paper import paper
    from rsicalib.results import Calibration, Trace, load_calibration
    from rsicalib.shapes import Parameter, Step
    from rsicalib.simulation import Simulated, simulate
    from rsicalib.supposing import Supposition, suppose
    from rsicalib.warned import Warned

__all__ = [
    "DEMO",
    "Alarm",
    "Calibration",
    "Certificate",
    "Channel",
    "Device",
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
    "Step",
    "Supposition",
    "Term",
    "Trace",
    "UndeterminedError",
    "Warned",
    "Watch",
    "Watching",
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
    "workspace",
]

_HOMES = {
    "rsicalib._core": "Channel Mechanism Term __version__",
    "rsicalib.api": """DEMO calibrate demo fixture forward forward_sd inverse load_mechanism
        load_readings terms trace""",
    "rsicalib.certificates": "Certificate",
    "rsicalib.certifying": "certify",
    "rsicalib.devices": "Device",
    "rsicalib.errors": "InputError OpenLoopsWarning RsicalibError UndeterminedError",
    "rsicalib.export": "export_toml export_urdf",
    "rsicalib.exports.opening": "export_result",
    "rsicalib.fleets.devices": "calibrate_devices",
    "rsicalib.fleets.run": "Fleet fleet",
    "rsicalib.identifiability": "Identifiable identifiable",
    "rsicalib.imports.log": "Log",
    "rsicalib.imports.opening": "import_log",
    "rsicalib.io.readings": "Readings",
    "rsicalib.lifetime": "history",
    "rsicalib.measures": "Observability observability",
    "rsicalib.monitor": "Alarm Monitor Watch Watching watch",
    "rsicalib.placing": "Placer",
    "rsicalib.planning": "plan",
    "rsicalib.plans": "Plan",
    "rsicalib.platform_sd": "Workspace workspace",
    "rsicalib.report.past": "History",
    "rsicalib.reproduction.document": "Paper",
    "rsicalib.reproduction.paper": "paper",
    "rsicalib.results": "Calibration Trace load_calibration",
    "rsicalib.shapes": "Parameter Step",
    "rsicalib.simulation": "Simulated simulate",
    "rsicalib.supposing": "Supposition suppose",
    "rsicalib.warned": "Warned",
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
        return sorted({*globals(), *__all__})
