"""The summary of a result for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

from rsicalib.report.words import (
    advice,
    comparison,
    excluded_words,
    labelled,
    law_words,
    name_of,
    noise_words,
    number,
    parameter_name,
    plus_minus,
    sentence,
    size_words,
)
from rsicalib.shapes import Parameter, ResultShape, TraceShape
from rsicalib.units import axis_words, with_unit

__all__ = ["summary"]

LINES = 23
"""With a blank one and the path of a report they are 25."""
WIDTH = 100
ADVICE = 5
"""Lines of what to do next that there is always room for."""


def summary(result: ResultShape) -> str:
    """Write what was found in a few lines for a terminal.

    Parameters
    ----------
    result : Calibration or Trace
        What was found.

    Returns
    -------
    str
        Lines without a line feed at the end.
    """
    head = textwrap.wrap(sentence(result), WIDTH)[:4]
    data = result.readings
    head += ["", f"  {'readings':10}{data.poses} poses, {data.samples} samples"]
    head += [f"  {'noise':10}{noise_words(result)}"]
    head += _earlier(result)
    head += _listed("warning", result.warnings, 1)
    middle = _errors(result)
    if isinstance(result, TraceShape):
        middle = [*_found(result), *_left_out(result), *middle, *_left(result)]
    else:
        middle = [*_left_out(result), *middle]
    free = LINES - len(head) - len(middle) - 2 if isinstance(result, TraceShape) else 0
    tail = _advice(result, max(free, ADVICE))
    if tail:
        tail = ["", *tail]
    room = LINES - len(head) - len(tail) - 1
    if not isinstance(result, TraceShape):
        middle += ["", *_parameters(result, room - len(middle) - 1)]
    if len(middle) > room:
        middle = [*middle[: room - 1], f"  … {len(middle) - room + 1} more lines in the report"]
    return "\n".join([*head, "", *middle, *tail][:LINES])


def _cut(line: str) -> str:
    return line if len(line) <= WIDTH else f"{line[: WIDTH - 2].rstrip()} …"


def _earlier(result: ResultShape) -> list[str]:
    """What has changed since an earlier result, and whether it is worth an update: whole."""
    if result.update is None:
        return []
    return textwrap.wrap(
        result.update.text, WIDTH, initial_indent=f"  {'earlier':10}", subsequent_indent=" " * 12
    )[:4]


def _listed(label: str, texts: Sequence[str], most: int) -> list[str]:
    """A line for each of the first texts, and how many more there are."""
    more = len(texts) - most
    lines = [_cut(f"  {label:10}{text}") for text in texts[:most]]
    return [*lines, f"  {'':10}and {more} more"] if more > 0 else lines


def _advice(result: ResultShape, room: int) -> list[str]:
    """What to do next: whole sentences, as many as there is room for, the first in any case."""
    lines: list[str] = []
    for text in advice(result)[:3]:
        more = _next(text)
        if not lines or len(lines) + len(more) <= room:
            lines += more[:room]
    return lines


def _next(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="→ ", subsequent_indent="  ")


def _errors(result: ResultShape) -> list[str]:
    heads, rows = comparison(result)
    rows = [row for row in rows if row[0] != "p-value"]  # it stands in the first line
    # What has the least to say comes last, where lines are cut.
    rows.sort(key=lambda row: row[0].startswith("held-out"))
    if not rows:
        return []
    if all(old == "–" for _, old, _ in rows):
        return _columns([(name, new) for name, _, new in rows], 14)
    return _columns([("", *heads), *rows], 14)


def _columns(rows: Sequence[Sequence[str]], least: int) -> list[str]:
    """Names to the left, and what each has to the right, in columns that never touch."""
    first = max(len(row[0]) for row in rows) + 2
    wide = [max(least, max(map(len, cells)) + 2) for cells in zip(*rows, strict=True)][1:]
    return [
        f"  {row[0]:{first}}" + "".join(f"{c:>{w}}" for c, w in zip(row[1:], wide, strict=True))
        for row in rows
    ]


def _found(result: TraceShape) -> list[str]:
    lines = []
    for step in result.steps[:4]:
        where = labelled(step.target, step.label)
        line = f"  found     {name_of(step.term)} of {where}: {size_words(step)}"
        if step.platform_rms is not None:
            rms = step.platform_rms
            cost = f"{number(rms.position, 2)} {result.length_unit}"
            extra = f"; platform {cost}, {number(rms.orientation, 2)} rad"
            line += extra if len(line) + len(extra) <= WIDTH else ""
        lines.append(_cut(line))
        if step.also_fits:
            names = [f"{name_of(n.term)} of {n.target}" for n in step.also_fits]
            more = "" if len(names) < 4 else f" and {len(names) - 3} more"
            lines.append(_cut(f"            fits as well: {', '.join(names[:3])}{more}"))
        if step.curve_law is not None:
            lines.append(_cut(f"            {law_words(step.curve_law)}"))
    return lines if not lines or result.excluded else [*lines, ""]


def _left_out(result: ResultShape) -> list[str]:
    lines = _listed("left out", [excluded_words(e) for e in result.excluded], 3)
    return [*lines, ""] if lines else []


def _left(result: TraceShape) -> list[str]:
    lines = []
    # Where something is, it stands whole among what to do next.
    if result.unexplained is not None and result.unexplained.target is None:
        lines.append(_cut(f"  left over {result.unexplained.text}"))
    for hidden in result.could_hide[:1]:
        rms = hidden.platform_rms
        cost = (
            ""
            if rms is None
            else f", {number(rms.position, 2)} {result.length_unit} at the platform"
        )
        size = with_unit(number(hidden.detectable, 2), hidden.unit)
        name = f"{name_of(hidden.term)} of {labelled(hidden.target, hidden.label)}"
        lines.append(_cut(f"  may hide  {name} up to {size}{cost}"))
    return ["", *lines] if lines else []


def _parameters(result: ResultShape, room: int) -> list[str]:
    """Offsets and gains side by side, by channel; then the others."""
    sensors: dict[str, dict[str, Parameter]] = {}
    others = []
    for p in result.parameters:
        if p.term in ("offset", "gain"):
            where = labelled(p.target, result.labels.get(p.target))
            sensors.setdefault(where, {})[p.term] = p
        else:
            others.append(p)
    lines = _sensors(sensors) if sensors else []
    for p in others:
        name = parameter_name(p.term, p.name)
        lines.append(_cut(f"  {p.target:9} {name} = {with_unit(_estimate(p), p.unit)}"))
    if len(lines) > room:
        lines = [*lines[: max(room - 1, 0)], f"  … {len(lines) - room + 1} more in the report"]
    return lines


def _sensors(sensors: Mapping[str, Mapping[str, Parameter]]) -> list[str]:
    """Offsets and gains by channel: their unit at the head, or beside each where units differ."""
    terms = [t for t in ("offset", "gain") if any(t in pair for pair in sensors.values())]
    rows = [["± 95 %"], *([target] for target in sensors)]
    for term in terms:
        units = {_unit(pair[term]) for pair in sensors.values() if term in pair}
        one = units.pop() if len(units) == 1 else None
        rows[0].append(axis_words(term, one))
        for row, pair in zip(rows[1:], sensors.values(), strict=True):
            p = pair.get(term)
            row.append("" if p is None else with_unit(_estimate(p), None if one else _unit(p)))
    return _columns(rows, 28)


def _unit(parameter: Parameter) -> str:
    """Gains of a converter are small: they are shown in thousandths."""
    return f"m{parameter.unit}" if parameter.unit == "rad/count" else parameter.unit


def _estimate(parameter: Parameter) -> str:
    scale = 1e3 if parameter.unit == "rad/count" else 1.0
    value = None if parameter.value is None else scale * parameter.value
    half = None if parameter.sd is None else 1.96 * scale * parameter.sd
    return " ± ".join(plus_minus(value, half))
