"""C: a header that turns readings into joint coordinates, a polynomial or a table per channel."""

from __future__ import annotations

import re

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.exports.ask import Ask
from rsicalib.exports.coordinates import coordinates, unit_of, without_place
from rsicalib.io.readings import Readings
from rsicalib.verbs.export import Noted
from rsicalib.work.arguments import Bare

__all__ = ["write"]

DEGREES = (1, 2, 3, 4, 5)
"""Of polynomials, the least that is good enough."""

FINE = 0.1
"""A curve is good enough if it errs by less than this part of the noise of one reading."""

GRID = 1025
"""Readings at which a curve is compared; a table has one entry for every 16th."""


def write(ask: Ask) -> dict[str, str]:
    """Write `rsicalib.h`: for each channel a function, its error stated."""
    units = unit_of(ask.mechanism)
    name = _identifier(ask.result.mechanism)
    out = [
        f"/* Joint coordinates of {_comment(ask.result.mechanism)} from readings,\n",
        f" * by rsicalib {ask.result.version}: {ask.result.verdict}.\n",
    ]
    left = without_place(ask.mechanism, ask.result)
    left += [note.text for note in ask.calibrated.notes if not _is_curve(ask, note)]
    out += [f" * not in here: {_comment(text)}\n" for text in left]
    out += [f" */\n#ifndef {name.upper()}_H\n#define {name.upper()}_H\n"]
    for number, channel in enumerate(ask.mechanism.channels):
        readings, wanted = _curve(ask, number)
        reference = ask.result.reference
        centre = float(reference.centre[number]) if reference is not None else 0.0
        noise = abs(channel.gain) * (
            ask.result.noise.sigma[channel.name] if ask.result.noise else 0
        )
        out.append(_function(channel.name, units[channel.name], readings, wanted, centre, noise))
    return {"rsicalib.h": "".join([*out, "\n#endif\n"])}


def _is_curve(ask: Ask, note: Noted) -> bool:
    """Whether what a mechanism has no words for is a sensor's, and so is in the functions."""
    return note.kind == "no_place" and note.term in _sensor_terms(ask)


def _sensor_terms(ask: Ask) -> set[str]:
    left = set(without_place(ask.mechanism, ask.result))
    return {p.term for p in ask.result.parameters if p.spec not in left}


def _curve(ask: Ask, number: int) -> tuple[FloatArray, FloatArray]:
    """Readings of a channel over its range, and the coordinates there, all others at their mean."""
    reference = ask.result.reference
    assert reference is not None  # `calibrated` has refused it
    centre = np.array(reference.centre)
    channel = ask.mechanism.channels[number]
    low, high = channel.range or reference.span[number]
    values = np.tile(centre, (GRID, 1))
    values[:, number] = np.linspace(low, high, GRID)
    for k, other in enumerate(ask.mechanism.channels):
        if other.range is not None:
            values[:, k] = np.clip(values[:, k], *other.range)
    readings = Readings.from_arrays(Bare(ask.mechanism), values, source="the range of a channel")
    return values[:, number], coordinates(readings, ask.mechanism, ask.result)[:, number]


def _function(
    name: str, unit: str, readings: FloatArray, wanted: FloatArray, centre: float, noise: float
) -> str:
    """One channel: the least polynomial that is good enough, else a table."""
    low, high = float(readings[0]), float(readings[-1])
    half = (high - low) / 2 or 1.0
    u = (readings - centre) / half
    scale = float(np.abs(wanted).max()) or 1.0
    enough = max(FINE * noise, 1e-12 * scale)
    label = _identifier(name)
    for degree in DEGREES:
        found = np.polynomial.polynomial.polyfit(u, wanted, degree)
        error = float(np.abs(np.polynomial.polynomial.polyval(u, found) - wanted).max())
        if error <= enough:
            terms = repr(float(found[-1]))
            for coefficient in found[-2::-1].tolist():
                terms = f"({terms} * u + {coefficient!r})"
            body = f"    const double u = (reading - {centre!r}) / {half!r};\n    return {terms};\n"
            words = f"polynomial of degree {degree}"
            break
    else:
        table = wanted[:: (GRID - 1) // 64]
        step = (high - low) / (len(table) - 1)
        error = float(
            np.abs(np.interp(readings, low + step * np.arange(len(table)), table) - wanted).max()
        )
        listed, last = ", ".join(map(repr, table.tolist())), len(table) - 2
        body = (
            f"    static const double table[{len(table)}] = {{{listed}}};\n"
            f"    const double at = (reading - {low!r}) / {step!r};\n"
            f"    int k = (int)at;\n    k = k < 0 ? 0 : k > {last} ? {last} : k;\n"
            "    return table[k] + (at - k) * (table[k + 1] - table[k]);\n"
        )
        words = f"table of {len(table)} entries"
    span = f"{low:g} to {high:g}"
    return (
        f"\n/* {_comment(name)} [{unit}] of its reading, {span}: {words}, "
        f"within {error:.2g} {unit} of the calibration. */\n"
        f"static inline double {label}_coordinate(double reading)\n{{\n{body}}}\n"
    )


def _identifier(name: str) -> str:
    found = re.sub(r"\W+", "_", name, flags=re.A).strip("_").lower()
    return found if found and not found[0].isdigit() else f"_{found}"


def _comment(text: str) -> str:
    return " ".join(text.replace("*/", "* /").split())
