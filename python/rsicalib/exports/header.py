"""C: a header that turns readings into joint coordinates, a polynomial or a table per channel."""

from __future__ import annotations

import re
from collections.abc import Collection

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.exports.ask import Ask
from rsicalib.exports.coordinates import coordinates, not_told, sensor_terms, unit_of, without_place
from rsicalib.io.readings import Readings
from rsicalib.verbs.export import Noted
from rsicalib.work.arguments import Bare

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
    lacking = not_told(_readings(ask, _centre(ask)[None]), ask.mechanism)
    notes = ask.calibrated.notes
    left = without_place(ask.mechanism, ask.result, notes)
    left += [note.text for note in notes if not _is_curve(ask, note, lacking)]
    out += [f" * not in here: {_comment(text)}\n" for text in left]
    out += [f" */\n#ifndef {name.upper()}_H\n#define {name.upper()}_H\n"]
    for number, channel in enumerate(ask.mechanism.channels):
        readings, wanted = _curve(ask, number, lacking)
        centre = float(_centre(ask)[number])
        noise = abs(channel.gain) * (
            ask.result.noise.sigma[channel.name] if ask.result.noise else 0
        )
        unit = units[channel.name]
        out.append(_function(channel.name, unit, readings, wanted, centre, noise))
        moved = _by_others(ask, number, lacking)
        if moved > max(FINE * noise, 1e-12 * float(np.abs(wanted).max())):
            out.insert(
                -1, f"\n/* Other channels at their mean; they move it by {moved:.2g} {unit}. */"
            )
    return {"rsicalib.h": "".join([*out, "\n#endif\n"])}


def _is_curve(ask: Ask, note: Noted, lacking: Collection[str]) -> bool:
    """Whether what a mechanism has no words for is a sensor's, and so is in the functions."""
    terms = sensor_terms(ask.mechanism, ask.result)
    return note.kind == "no_place" and note.term in terms - {*lacking}


def _curve(ask: Ask, number: int, lacking: Collection[str]) -> tuple[FloatArray, FloatArray]:
    """Readings of a channel over its range, and the coordinates there, all others at their mean."""
    values = np.tile(_centre(ask), (GRID, 1))
    values[:, number] = np.linspace(*_ends(ask, number), GRID)
    found = coordinates(_readings(ask, values), ask.mechanism, ask.result, without=lacking)
    return values[:, number], found[:, number]


def _by_others(ask: Ask, number: int, lacking: Collection[str]) -> float:
    """By how much the coordinate of a channel moves at its mean, as others go to their ends."""
    centre = _centre(ask)
    rows = [centre]
    for other in range(len(centre)):
        if other != number:
            rows += [
                np.where(np.arange(len(centre)) == other, e, centre) for e in _ends(ask, other)
            ]
    found = coordinates(_readings(ask, np.array(rows)), ask.mechanism, ask.result, without=lacking)
    off = np.abs(found[1:, number] - found[0, number]).reshape(-1, 2)
    return float(off.max(axis=1, initial=0.0).sum())


def _centre(ask: Ask) -> FloatArray:
    """Middle of the readings of each channel, within its range."""
    reference = ask.result.reference
    assert reference is not None  # `calibrated` has refused it
    ranges = [c.range or (-np.inf, np.inf) for c in ask.mechanism.channels]
    centre: FloatArray = np.clip(np.mean(reference.span, axis=1), *np.array(ranges).T)
    return centre


def _ends(ask: Ask, number: int) -> tuple[float, float]:
    """Range of a channel, or what it read."""
    reference = ask.result.reference
    assert reference is not None  # `calibrated` has refused it
    low, high = ask.mechanism.channels[number].range or reference.span[number]
    return low, high


def _readings(ask: Ask, values: FloatArray) -> Readings:
    return Readings.from_arrays(Bare(ask.mechanism), values, source="the range of a channel")


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
