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
    from rsicalib.errors import InputError, RsicalibError, UndeterminedError
    from rsicalib.export import export_toml, export_urdf
    from rsicalib.exports.opening import export_result
    from rsicalib.fleets.devices import calibrate_devices
    from rsicalib.fleets.run import Fleet, fleet
    from rsicalib.identifiability import identifiable
    from rsicalib.imports.log import Log
    from rsicalib.imports.opening import import_log
    from rsicalib.io.readings import Readings
    from rsicalib.lifetime import history
    from rsicalib.measures import observability
    from rsicalib.monitor import Alarm, Monitor, watch
    from rsicalib.planning import plan
    from rsicalib.platform_sd import workspace
    from rsicalib.reproduction.paper import paper
    from rsicalib.results import Calibration, Trace, load_calibration
    from rsicalib.shapes import Parameter, Step
    from rsicalib.simulation import simulate
    from rsicalib.supposing import suppose

__all__ = [
    "DEMO",
    "Alarm",
    "Calibration",
    "Channel",
    "Fleet",
    "InputError",
    "Log",
    "Mechanism",
    "Monitor",
    "Parameter",
    "Readings",
    "RsicalibError",
    "Step",
    "Term",
    "Trace",
    "UndeterminedError",
    "__version__",
    "calibrate",
    "calibrate_devices",
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
    "rsicalib.errors": "InputError RsicalibError UndeterminedError",
    "rsicalib.export": "export_toml export_urdf",
    "rsicalib.exports.opening": "export_result",
    "rsicalib.fleets.devices": "calibrate_devices",
    "rsicalib.fleets.run": "Fleet fleet",
    "rsicalib.lifetime": "history",
    "rsicalib.identifiability": "identifiable",
    "rsicalib.imports.log": "Log",
    "rsicalib.imports.opening": "import_log",
    "rsicalib.io.readings": "Readings",
    "rsicalib.measures": "observability",
    "rsicalib.monitor": "Alarm Monitor watch",
    "rsicalib.planning": "plan",
    "rsicalib.platform_sd": "workspace",
    "rsicalib.reproduction.paper": "paper",
    "rsicalib.results": "Calibration Trace load_calibration",
    "rsicalib.shapes": "Parameter Step",
    "rsicalib.simulation": "simulate",
    "rsicalib.supposing": "suppose",
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
