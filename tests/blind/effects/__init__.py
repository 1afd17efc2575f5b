"""Undeclared effects, each with its own mathematics, at the place where nature has it."""

from tests.blind.effects.base import ARMS, CHANNELS, SIDES, Effect
from tests.blind.effects.electronics import ChannelSkew, ReferenceDrift, ReferenceTemperature
from tests.blind.effects.mishaps import (
    BadReading,
    BaseSlip,
    GrossSample,
    MissingCodes,
    Saturation,
    StuckBit,
)
from tests.blind.effects.outside import (
    Backlash,
    HandlePlay,
    Kink,
    Lag,
    LogCurve,
    RandomWalk,
    Ripple,
    StepInGain,
    WarmUp,
    WornSpot,
)
from tests.blind.effects.sensor import (
    Crosstalk,
    Cubic,
    Curvature,
    Drift,
    Hysteresis,
    OncePerTurn,
    Slip,
    TemperatureGain,
    TemperatureOffset,
    TwicePerTurn,
)
from tests.blind.effects.structure import (
    BasePosition,
    BaseTilt,
    Distance,
    JointTilt,
    LinkLength,
    LinkOffset,
    Sag,
)

SENSOR: tuple[type[Effect], ...] = (
    Curvature,
    Cubic,
    OncePerTurn,
    TwicePerTurn,
    Hysteresis,
    Drift,
    Slip,
    TemperatureOffset,
    TemperatureGain,
    Crosstalk,
)
ELECTRONICS: tuple[type[Effect], ...] = (ReferenceDrift, ReferenceTemperature, ChannelSkew)
STRUCTURE: tuple[type[Effect], ...] = (
    LinkLength,
    LinkOffset,
    JointTilt,
    BasePosition,
    BaseTilt,
    Distance,
    Sag,
)
MISHAPS: tuple[type[Effect], ...] = (BadReading, GrossSample)
CATALOGUE: tuple[type[Effect], ...] = SENSOR + ELECTRONICS + STRUCTURE + MISHAPS
"""What a good catalogue has."""

MOVED: tuple[type[Effect], ...] = (BaseSlip,)
"""What happened to the structure once."""

FAULTS: tuple[type[Effect], ...] = (StuckBit, MissingCodes, Saturation)
OUTSIDE: tuple[type[Effect], ...] = (
    Ripple,
    Kink,
    WornSpot,
    Backlash,
    Lag,
    RandomWalk,
    WarmUp,
    LogCurve,
    StepInGain,
    HandlePlay,
)
"""What none has."""

__all__ = [
    "ARMS",
    "CATALOGUE",
    "CHANNELS",
    "ELECTRONICS",
    "FAULTS",
    "MISHAPS",
    "MOVED",
    "OUTSIDE",
    "SENSOR",
    "SIDES",
    "STRUCTURE",
    "Backlash",
    "BadReading",
    "BasePosition",
    "BaseSlip",
    "BaseTilt",
    "ChannelSkew",
    "Crosstalk",
    "Cubic",
    "Curvature",
    "Distance",
    "Drift",
    "Effect",
    "GrossSample",
    "HandlePlay",
    "Hysteresis",
    "JointTilt",
    "Kink",
    "Lag",
    "LinkLength",
    "LinkOffset",
    "LogCurve",
    "MissingCodes",
    "OncePerTurn",
    "RandomWalk",
    "ReferenceDrift",
    "ReferenceTemperature",
    "Ripple",
    "Sag",
    "Saturation",
    "Slip",
    "StepInGain",
    "StuckBit",
    "TemperatureGain",
    "TemperatureOffset",
    "TwicePerTurn",
    "WarmUp",
    "WornSpot",
]
