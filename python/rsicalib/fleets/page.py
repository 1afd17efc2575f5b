"""The page of a fleet: which devices stand out, and whether all of them lack the same."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from itertools import islice
from pathlib import Path
from textwrap import shorten
from typing import Any
from urllib.parse import quote

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.facts.verdicts import EXIT_CODES, UNUSABLE
from rsicalib.fleets.frames import numbers_of
from rsicalib.fleets.map import map_figure
from rsicalib.fleets.population import lacks_together, summed
from rsicalib.fleets.standing_out import Remark, Spread
from rsicalib.plain_text import counted
from rsicalib.report.figure import Figure
from rsicalib.report.page import document, pictures, section, table
from rsicalib.report.svg import Canvas, Chart
from rsicalib.report.words import name_of, number, plus_minus
from rsicalib.units import axis_words

LISTED = 200
"""Devices that the page lists before it only counts."""

LONG = 240
"""Characters of a reason that is read at a glance; `fleet.parquet` has all of it."""

USED = EXIT_CODES.keys() - UNUSABLE
"""Verdicts of devices whose parameters can be compared with those of others."""

BINS = 20
HEIGHT = 220.0


def page(
    rows: Mapping[str, Sequence[Any]],
    by: str,
    mechanism: Mechanism,
    spread: Sequence[Spread],
    out: Sequence[Remark],
    together: Sequence[str] = (),
    at: Path | None = None,
    shifts: Sequence[Mapping[str, Any]] = (),
    reports: Mapping[str, str] | None = None,
    *,
    misfit: bool = False,
) -> str:
    """Write the page as one HTML file that needs no network.

    Parameters
    ----------
    rows : mapping of str to list
        Columns of `fleet.parquet`.
    by : str
        The column that names the device.
    mechanism : Mechanism
        What all devices are.
    spread : sequence of Spread
        How far parameters are apart, as `spreads` of the rows tells.
    out : sequence of Remark
        Devices that stand out, as `remarks` of the rows tells.
    together : sequence of str
        What the devices have in common, in sentences.
    at : Path, optional
        Folder that the page is for: files of devices are links from there.
    shifts : sequence of dict
        How far parameters are from the drawing, and how much they differ, as `first_line` tells.
    reports : mapping of str to str, optional
        Of some devices the report, from the folder of the page.
    misfit : bool
        Whether the devices together do not fit, or not the drawing: no page of a good fleet.

    Returns
    -------
    str
        The document.
    """
    devices = list(dict.fromkeys(str(remark.device) for remark in out))
    listed = set(devices[:LISTED])
    files = _files(rows, by, listed)
    links = {**_links(files, at), **(reports or {})}
    good = "bad" if devices or misfit else "good"
    count = len(rows[by])
    sentence = f"{len(devices) or 'None'} of {count} devices stand{'s' * (len(devices) < 2)} out."
    parts = [
        f"<h1>Fleet of {escape(mechanism.name)}</h1>",
        f'<p class="verdict {good}">{escape(sentence)}</p>',
        *(f"<p>{escape(line)}</p>" for line in together),
        _verdicts(rows),
        section(
            "All at a glance", pictures([map_figure(spread, rows, by, devices, links), _fits(rows)])
        ),
        _remarks(out, _found(rows, by, listed), files, links, len(reports or {})),
        _effects(rows),
        _parameters(spread, rows, by, mechanism),
        _differ(shifts, mechanism),
        f'<p class="faint">rsicalib {escape(_core.__version__)}; every number is in '
        "<code>fleet.parquet</code>.</p>",
    ]
    name = f"Fleet of {mechanism.name}"
    return document(f"{name}: {counted(count, 'device')}", parts, name)


def _verdicts(rows: Mapping[str, Sequence[Any]]) -> str:
    counts = Counter(verdict or "refused" for verdict in rows["verdict"])
    words = ", ".join(f"{n} {verdict.replace('_', ' ')}" for verdict, n in counts.most_common())
    return f"<p>{escape(words)}.</p>"


def _found(rows: Mapping[str, Sequence[Any]], by: str, listed: set[str]) -> dict[str, str]:
    """What was traced in each of some devices, as words."""
    found = {}
    for device, steps in zip(rows[by], rows["steps"], strict=True):
        if str(device) not in listed:
            continue
        names = [f"{name_of(s['term'])} of {s['target']}" for s in json.loads(steps or "[]")]
        found[str(device)] = ", ".join(names)
    return found


def _files(rows: Mapping[str, Sequence[Any]], by: str, listed: set[str]) -> dict[str, str]:
    """The file of each of some devices, where each has its own."""
    if "file" not in rows:
        return {}
    pairs = zip(rows[by], rows["file"], strict=True)
    return {str(device): file or "" for device, file in pairs if str(device) in listed}


def _why(own: Sequence[Remark], found: str) -> str:
    """Why a device stands out, in one cell: what was traced, its verdict, its worst parameter."""
    said = [found, *(r.why for r in own if not r.parameter)]
    # Numbers that cannot be used are far from all others: that says nothing more.
    odd = [r for r in own if r.parameter and (r.verdict in USED or not any(said))]
    if odd:
        said.append(max(odd, key=lambda r: r.size).why)
    if len(odd) > 1:
        said.append(f"and {counted(len(odd) - 1, 'more parameter')}")
    words = "; ".join(filter(None, said))
    end = words.rfind(". ", 0, LONG)  # whole sentences, where there are some
    short = len(words) <= LONG or end < 0
    return shorten(words, LONG, placeholder=" …") if short else f"{words[: end + 1]} …"


def _remarks(
    out: Sequence[Remark],
    found: Mapping[str, str],
    files: Mapping[str, str],
    links: Mapping[str, str],
    reports: int,
) -> str:
    """A row for each device, with a link to its report, or else to its file where it has one."""
    by_device: dict[str, list[Remark]] = {}
    for remark in out:
        by_device.setdefault(str(remark.device), []).append(remark)
    if not by_device:
        return ""
    listed = [
        (
            device,
            own[0].verdict.replace("_", " "),
            _why(own, found[device]),
            *([files[device]] if files else []),
        )
        for device, own in islice(by_device.items(), LISTED)
    ]
    more = len(by_device) - len(listed)
    heads = ("device", "verdict", "why", *(["file"] if files else []))
    words = "devices that stand out"
    shown = table(heads, listed, len(heads), words, long="why", links=links)
    notes = [f"and {more} more"] * (more > 0)
    if reports:
        notes.append(
            f"{counted(reports, 'report')} of single devices; --reports N writes more or fewer"
        )
    elif files:
        notes.append(
            "rsicalib trace FILE --mechanism MECHANISM --out FOLDER writes the report of one device"
        )
    return section(words.capitalize(), shown, *(f'<p class="faint">{n}</p>' for n in notes))


def _links(files: Mapping[str, str], at: Path | None) -> dict[str, str]:
    """Where the page, which is in the folder `at`, finds the file of each device."""
    if at is None:
        return {}
    links = {}
    for device, file in files.items():
        with contextlib.suppress(ValueError):  # none, or on another drive of Windows
            links[device] = quote(Path(os.path.relpath(file, at)).as_posix())
    return links


def _effects(rows: Mapping[str, Sequence[Any]]) -> str:
    """What was traced, by the number of devices: what many share is a matter of the design."""
    found = Counter(
        (step["term"], step["target"])
        for steps, devices in Counter(rows["steps"]).items()
        for step in json.loads(steps or "[]") * devices
    )
    if not found:
        return ""
    listed = [(name_of(term), target, str(n)) for (term, target), n in found.most_common(20)]
    heads = ("effect", "target", "devices")
    return section("Effects found", table(heads, listed, 2, "effects found"))


def _fits(rows: Mapping[str, Sequence[Any]]) -> Figure | None:
    """Histogram of the p-values, which is flat where the model lacks nothing."""
    known = numbers_of(rows, "p_value")
    known = known[np.isfinite(known)]
    if len(known) < 2 * BINS:
        return None
    counts: list[int] = np.histogram(known, BINS, (0.0, 1.0))[0].tolist()
    expected = len(known) / BINS

    def draw(width: float) -> str:
        canvas = Canvas(width, HEIGHT)
        most = max(*counts, math.ceil(expected))
        words = "p-value of the test of fit", "devices"
        chart = Chart.on(canvas, (0.0, 1.0), (0.0, 1.05 * most), words, height=HEIGHT)
        for k, n in enumerate(counts):
            left, top = chart.at((k / BINS, n))
            right, bottom = chart.at(((k + 1) / BINS, 0.0))
            said = f"p from {k / BINS:g} to {(k + 1) / BINS:g}: {counted(n, 'device')}"
            canvas.rect(left + 1.0, top, right - left - 2.0, bottom - top, "bar", said)
        chart.curve([(0.0, expected), (1.0, expected)], "law thin")
        return canvas.svg("histogram of p-values")

    words = (
        f"p-values of the test of fit. {counts[0]} devices have p below {1 / BINS:g}; by chance "
        f"{expected:.0f} would, which the line shows."
    )
    if lacks_together(summed(rows)):
        words += " All together lack an effect that one device alone may not show."
    return Figure("fits", draw, words)


def _with_unit(parameter: str, mechanism: Mechanism) -> str:
    """A parameter and its unit, where there is one: `gain@a11 [rad/count]`."""
    return axis_words(parameter, _core.unit_of_key(mechanism, parameter))


def _differ(shifts: Sequence[Mapping[str, Any]], mechanism: Mechanism) -> str:
    """How much devices, or what is above them, differ beside the errors of their estimates."""
    if not shifts:
        return ""
    named = [{**s, "parameter": _with_unit(s["parameter"], mechanism)} for s in shifts]
    heads, listed = _of_levels(named) if "levels" in named[0] else _of_devices(named)
    words = "differences over the fleet"
    return section("How much devices differ", table(heads, listed, 1, words, wide=True))


def _of_devices(shifts: Sequence[Mapping[str, Any]]) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Heads and rows of a table with one row for each parameter."""
    heads = ("parameter", "mean from the drawing", "sd between devices", "95 %")
    rows: list[Sequence[str]] = [
        (s["parameter"], _mean(s), number(s["between"]), _ends(s["between_interval"]))
        for s in shifts
    ]
    return heads, rows


def _of_levels(shifts: Sequence[Mapping[str, Any]]) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Heads and rows of a table with one row for each level of each parameter."""
    heads = ("parameter", "mean from the drawing", "between (groups)", "sd", "95 %")
    rows: list[Sequence[str]] = []
    for one in shifts:
        head = one["parameter"], _mean(one)
        for level in one["levels"]:
            name = f"{level['level']} ({level['groups']})"
            apart = number(level["sd"]), _ends(level["interval"])
            if level["sd"] is None:
                same = level["same_as"]
                apart = "not told", "one group" if same is None else f"the groups of {same}"
            rows.append((*head, name, *apart))
            head = "", ""
    return heads, rows


def _mean(shift: Mapping[str, Any]) -> str:
    """How far a parameter is from the drawing, on average."""
    if shift["p_value"] is None or shift["half"] is None:
        return "–"
    return " ± ".join(plus_minus(shift["value"], shift["half"]))


def _ends(ends: Sequence[float | None] | None) -> str:
    """An interval of 95 % of a standard deviation, in words."""
    if ends is None:
        return "less than their errors"
    low, high = ends
    return f"{number(low or 0.0)} … {'unknown' if high is None else number(high)}"


def _parameters(
    spread: Sequence[Spread], rows: Mapping[str, Sequence[Any]], by: str, mechanism: Mechanism
) -> str:
    if not spread:
        return ""
    listed, labels = [], rows[by]
    for one in spread:
        furthest, far = one.furthest
        numbers = (plus_minus(one.median, one.within)[0], *map(number, (one.between, one.within)))
        name = _with_unit(one.name, mechanism)
        listed.append((name, *numbers, f"{labels[furthest]} ({far:.1f} sd)"))
    heads = ("parameter", "median", "sd between devices", "sd of one device", "furthest")
    words = "parameters over the fleet"
    return section("Parameters over the fleet", table(heads, listed, 1, words, wide=True))
