# Written by `python -m scripts.make_stub`; a test compares.
from rsicalib._core import Channel, Mechanism, Term, __version__
from rsicalib.api import DEMO, demo, load_mechanism, load_readings, terms
from rsicalib.errors import (
    InputError,
    InputTypeError,
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
from rsicalib.poses.kinematics import forward, forward_sd, inverse
from rsicalib.poses.placing import Placer
from rsicalib.poses.simulation import Simulated, simulate
from rsicalib.report.figure import Figure
from rsicalib.report.past import History
from rsicalib.reproduction.document import Paper
from rsicalib.reproduction.paper import paper
from rsicalib.results.certificate import Certificate
from rsicalib.results.result import Calibration, Trace, load_calibration
from rsicalib.verbs.calibration import calibrate
from rsicalib.verbs.certifying import certify
from rsicalib.verbs.devices import WatchingDevices, watch_devices
from rsicalib.verbs.export import export_toml, export_urdf
from rsicalib.verbs.lifetime import history
from rsicalib.verbs.monitor import Alarm, Monitor, Watch, Watching, watch
from rsicalib.verbs.open_loop import fixture
from rsicalib.verbs.tracing import trace

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
    "InputTypeError",
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
