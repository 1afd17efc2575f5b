"""ROS 2: gains and offsets of the joints as a file of parameters (YAML)."""

from __future__ import annotations

import json

from rsicalib.exports.ask import Ask
from rsicalib.exports.coordinates import unit_of, without_place


def write(ask: Ask) -> dict[str, str]:
    """Write the parameters; a quoted text of JSON is one of YAML too."""
    units = unit_of(ask.mechanism)
    found = ask.calibrated
    lines = ["# coordinate = gain * reading + offset\n"]
    left = [*without_place(ask.mechanism, ask.result, found.notes), *found.said]
    lines += [f"# not in here: {note}\n" for note in dict.fromkeys(left)]
    lines += ["/**:\n  ros__parameters:\n    calibration:\n"]
    about = {"mechanism": found.mechanism.name, "length_unit": found.mechanism.length_unit}
    about |= {"verdict": ask.result.verdict, "valid_from": ask.result.valid_from or ""}
    lines += [f"      {name}: {json.dumps(text)}\n" for name, text in about.items()]
    names = [channel.name for channel in found.mechanism.channels]
    lines += [f"      joint_names: {json.dumps(names)}\n      joints:\n"]
    for channel in found.mechanism.channels:
        lines.append(f"        {json.dumps(channel.name)}:\n")
        lines.append(f"          gain: {_number(channel.gain)}\n")
        lines.append(f"          offset: {_number(channel.offset)}\n")
        lines.append(f"          reading_unit: {json.dumps(channel.unit)}\n")
        lines.append(f"          unit: {json.dumps(units[channel.name])}\n")
    return {"calibration.yaml": "".join(lines)}


def _number(value: float) -> str:
    """A number that YAML 1.1 takes for one: with a point, also before an exponent."""
    text = repr(float(value))
    head, mark, tail = text.partition("e")
    head = head if "." in head else f"{head}.0"
    sign = "" if not mark or tail[0] in "+-" else "+"
    return f"{head}{mark}{sign}{tail}"
