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

from rsicalib._core import Channel, Mechanism, __version__
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
from rsicalib.identifiability import identifiable
from rsicalib.io.readings import Readings
from rsicalib.measures import observability
from rsicalib.planning import plan
from rsicalib.reproduction.paper import paper
from rsicalib.results import Calibration, Trace, load_calibration
from rsicalib.shapes import Parameter, Step
from rsicalib.simulation import simulate

__all__ = [
    "DEMO",
    "Calibration",
    "Channel",
    "InputError",
    "Mechanism",
    "Parameter",
    "Readings",
    "RsicalibError",
    "Step",
    "Trace",
    "UndeterminedError",
    "__version__",
    "calibrate",
    "demo",
    "export_toml",
    "export_urdf",
    "fixture",
    "forward",
    "forward_sd",
    "identifiable",
    "inverse",
    "load_calibration",
    "load_mechanism",
    "load_readings",
    "observability",
    "paper",
    "plan",
    "simulate",
    "terms",
    "trace",
]
