"""The page of a fleet: which devices stand out, and whether all of them lack the same."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.fleets.map import map_figure
from rsicalib.fleets.standing_out import Remark, Spread, remarks, spreads
from rsicalib.report.figure import STYLE
from rsicalib.report.words import name_of

__all__ = ["page"]

LISTED = 200
"""Devices that the page lists before it only counts."""

BINS = 20
WIDTH, HEIGHT, FOOT = 720.0, 160.0, 30.0


def page(
    rows: Mapping[str, Sequence[Any]], by: str, mechanism: Mechanism, together: Sequence[str] = ()
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
    together : sequence of str
        What the devices have in common, in sentences.

    Returns
    -------
    str
        The document.
    """
    spread = spreads(rows)
    out = remarks(rows, by, spread)
    devices = {remark.device for remark in out}
    good = "bad" if devices else "good"
    count = len(rows[by])
    sentence = f"{len(devices) or 'None'} of {count} devices stand{'s' * (len(devices) < 2)} out."
    parts = [
        f"<h1>Fleet of {escape(mechanism.name)}</h1>",
        f'<p class="verdict {good}">{escape(sentence)}</p>',
        *(f"<p>{escape(line)}</p>" for line in together),
        _verdicts(rows),
        _map(spread, rows, by),
        _remarks(out, _found(rows, by)),
        _effects(rows),
        _fits(rows),
        _parameters(spread, rows, by),
        f'<p class="faint">rsicalib {escape(_core.__version__)}; every number is in '
        "<code>fleet.parquet</code>.</p>",
    ]
    body = "\n".join(part for part in parts if part)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Fleet of {escape(mechanism.name)}: {count} devices</title>\n"
        f"<style>{STYLE}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    def cells(row: Sequence[str], tag: str) -> str:
        return "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row)

    body = "\n".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    head = f"<thead><tr>{cells(heads, 'th')}</tr></thead>"
    return f'<div class="scroll"><table>{head}\n<tbody>\n{body}\n</tbody></table></div>'


def _verdicts(rows: Mapping[str, Sequence[Any]]) -> str:
    counts = Counter(verdict or "refused" for verdict in rows["verdict"])
    words = ", ".join(f"{n} {verdict}" for verdict, n in counts.most_common())
    return f"<p>{escape(words)}.</p>"


def _map(spread: Sequence[Spread], rows: Mapping[str, Sequence[Any]], by: str) -> str:
    figure = map_figure(spread, rows, by)
    return f"<h2>All at a glance</h2>\n{figure.html()}" if figure is not None else ""


def _found(rows: Mapping[str, Sequence[Any]], by: str) -> dict[str, str]:
    """What was traced in each device, as words."""
    found = {}
    for device, steps in zip(rows[by], rows["steps"], strict=True):
        names = [f"{name_of(s['term'])} of {s['target']}" for s in json.loads(steps or "[]")]
        found[str(device)] = ", ".join(names)
    return found


def _remarks(out: Sequence[Remark], found: Mapping[str, str]) -> str:
    if not out:
        return ""
    listed = [(str(r.device), r.verdict, r.why or found[str(r.device)]) for r in out[:LISTED]]
    more = f'<p class="faint">and {len(out) - LISTED} more</p>' if len(out) > LISTED else ""
    heads = ("device", "verdict", "why")
    return f"<h2>Devices that stand out</h2>\n{_table(heads, listed)}{more}"


def _effects(rows: Mapping[str, Sequence[Any]]) -> str:
    """What was traced, by the number of devices: what many share is a matter of the design."""
    found = Counter(
        (step["term"], step["target"])
        for steps in rows["steps"]
        for step in json.loads(steps or "[]")
    )
    if not found:
        return ""
    listed = [(term, target, str(n)) for (term, target), n in found.most_common(20)]
    return f"<h2>Effects found</h2>\n{_table(('term', 'target', 'devices'), listed)}"


def _fits(rows: Mapping[str, Sequence[Any]]) -> str:
    """Histogram of the p-values, which is flat where the model lacks nothing."""
    known = [p for p in rows["p_value"] if p is not None and math.isfinite(p)]
    if len(known) < 2 * BINS:
        return ""
    counts = [0] * BINS
    for p in known:
        counts[min(int(p * BINS), BINS - 1)] += 1
    most, wide = max(counts), WIDTH / BINS
    bars = []
    for k, n in enumerate(counts):
        tall = (HEIGHT - FOOT) * n / most
        box = f'x="{k * wide + 1:.1f}" y="{HEIGHT - FOOT - tall:.1f}"'
        bars.append(f'<rect class="dot" {box} width="{wide - 2:.1f}" height="{tall:.1f}"/>')
    level = HEIGHT - FOOT - (HEIGHT - FOOT) * len(known) / BINS / most
    bars.append(f'<line class="axis" x1="0" x2="{WIDTH:g}" y1="{level:.1f}" y2="{level:.1f}"/>')
    for at, words, anchor in ((0.0, "p = 0", "start"), (WIDTH, "1", "end")):
        bars.append(f'<text x="{at:g}" y="{HEIGHT - 10:g}" text-anchor="{anchor}">{words}</text>')
    low, expected = counts[0], len(known) / BINS
    words = f"{low} devices have p below {1 / BINS:g}; by chance {expected:.0f} would."
    if low > expected + 4.0 * math.sqrt(expected):
        words += " The devices as a whole lack an effect that one device alone may not show."
    return (
        "<h2>Test of fit over the fleet</h2>\n<figure>"
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="histogram of p-values" '
        f'xmlns="http://www.w3.org/2000/svg">{"".join(bars)}</svg>'
        f"<figcaption>p-values of the test of fit. {escape(words)}</figcaption></figure>"
    )


def _parameters(spread: Sequence[Spread], rows: Mapping[str, Sequence[Any]], by: str) -> str:
    if not spread:
        return ""
    listed = []
    for one in spread:
        far = [0.0 if math.isnan(z) else abs(z) for z in one.far.tolist()]
        furthest = max(range(len(far)), key=far.__getitem__)
        numbers = (f"{v:.6g}" for v in (one.median, one.between, one.within))
        listed.append((one.name, *numbers, f"{rows[by][furthest]} ({far[furthest]:.1f} sd)"))
    heads = ("parameter", "median", "sd between devices", "sd of one device", "furthest")
    return f"<h2>Parameters over the fleet</h2>\n{_table(heads, listed)}"
