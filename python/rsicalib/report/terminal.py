"""The summary of a result for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rsicalib.facts.shapes import Parameter, ResultShape, TraceShape
from rsicalib.plain_text import counted, wrapped
from rsicalib.report.words import (
    IN_PYTHON,
    Kept,
    advice,
    between_words,
    comparison,
    elsewhere_words,
    labelled,
    law_words,
    left_out,
    mistaken,
    moved_words,
    name_of,
    noise_words,
    noisier,
    not_applied,
    not_tried,
    number,
    parameter_name,
    plus_minus,
    sentence,
    size_words,
    target_words,
    with_bounds,
)
from rsicalib.units import HALF_95, axis_words, with_unit

LINES = 23
"""With a blank one and the path of a report they are 25, in lines of `WIDTH` columns."""
WIDTH = 100
"""Columns where nobody says how wide the terminal is: a file, a pipe."""
NARROW = 40
"""Columns that text is never made narrower than."""
NAME = 20
"""Columns in which a name of a row is broken into lines; in fewer it stands above."""
HIDDEN = 12
"""Effects that could hide which are listed where everything is said, as in the report."""
ADVICE = 5
"""Lines of what to do next that there is always room for."""


LABELS = (
    *("readings", "noise", "groups", "earlier", "warning", "found", "formula", "elsewhere"),
    *("left out", "noisier", "left over", "may hide", "not tried"),
)
"""What stands before the lines of a summary, and is faint on a terminal."""


@dataclass(frozen=True)
class Look:
    """How wide lines are, and whether everything is said, in as many lines as it takes."""

    width: int = WIDTH
    whole: bool = False

    def lines(self, most: int) -> int:
        """Lines that hold what so many lines of the usual width hold."""
        return max(most, -(-most * WIDTH // self.width))


def summary(
    result: ResultShape,
    *,
    width: int | None = None,
    whole: bool = False,
    kept: Kept = IN_PYTHON,
) -> str:
    """Write what was found in a few lines for a terminal.

    Parameters
    ----------
    result : Calibration or Trace
        What was found.
    width : int, optional
        Columns of the terminal; 100 where not given.
    whole : bool
        Say everything, in as many lines as it takes: for a file, or a pipe.
    kept : Kept, optional
        Where the result stands; in memory where not given.

    Returns
    -------
    str
        Lines without a line feed at the end.
    """
    look = Look(WIDTH if width is None else max(NARROW, width), whole)
    advised = advice(result, kept)
    head = _most(wrapped(sentence(result), look.width), 4, look)
    data = result.readings
    head += [
        "",
        _labelled("readings", f"{counted(data.poses, 'pose')}, {counted(data.samples, 'sample')}"),
    ]
    head += _entry("noise", noise_words(result), look)
    if between := between_words(result):
        head += _most(_entry("groups", between, look), 4, look)
    head += _earlier(result, look)
    head += _listed("warning", [str(warned) for warned in result.warnings], 1, look)
    middle = _errors(result, look)
    if isinstance(result, TraceShape):
        middle = [*_found(result, look), *_left_out(result, look), *middle, *_left(result, look)]
    else:
        middle = [*_left_out(result, look), *middle]
    if whole:
        tail = _advice(advised, None, look)
        parts = [head, middle, _parameters(result, None, look), tail]
        return "\n\n".join("\n".join(part).removeprefix("\n") for part in parts if any(part))
    lines = look.lines(LINES)
    free = lines - len(head) - len(middle) - 2 if isinstance(result, TraceShape) else 0
    tail = _advice(advised, max(free, look.lines(ADVICE)), look)
    if tail:
        tail = ["", *tail]
    room = max(lines - len(head) - len(tail) - 1, 1)
    if not isinstance(result, TraceShape):
        middle += ["", *_parameters(result, room - len(middle) - 1, look)]
    if len(middle) > room:
        middle = [*middle[: room - 1], f"  … {len(middle) - room + 1} more lines in the report"]
    return "\n".join([*head, "", *middle, *tail])


def _most(lines: list[str], most: int, look: Look) -> list[str]:
    """What so many lines of the usual width hold, with a mark where that is not all of it; all
    where everything is said.
    """
    most = look.lines(most)
    if look.whole or len(lines) <= most:
        return lines
    return [*lines[: most - 1], f"{lines[most - 1][: look.width - 2]} …"]


def _cut(line: str, look: Look) -> list[str]:
    """A line, the next ones indented, of which what a line of the usual width holds is whole."""
    if len(line) <= look.width:
        return [line]
    return _most(wrapped(line, look.width, subsequent_indent=" " * 12), 1, look)


def _labelled(label: str, text: str) -> str:
    """A line with its label, one of `LABELS`."""
    return f"  {LABELS[LABELS.index(label)]:10}{text}"


def _entry(label: str, text: str, look: Look) -> list[str]:
    """A label with what it is about, in as many lines as that takes."""
    first = _labelled(label, "")
    return wrapped(text, look.width, initial_indent=first, subsequent_indent=" " * 12)


def _earlier(result: ResultShape, look: Look) -> list[str]:
    """What has changed since an earlier result, and whether it is worth an update: whole."""
    if result.update is None:
        return []
    return _most(_entry("earlier", result.update.text, look), 4, look)


def _listed(label: str, texts: Sequence[str], most: int, look: Look) -> list[str]:
    """A line for each of the first texts, and how many more there are."""
    if look.whole:
        most = len(texts)
    more = len(texts) - most
    lines = [line for text in texts[:most] for line in _cut(_labelled(label, text), look)]
    return [*lines, f"  {'':10}and {more} more"] if more > 0 else lines


def _advice(advised: Sequence[str], room: int | None, look: Look) -> list[str]:
    """What to do next: whole sentences, as many as there is room for, the first in any case."""
    lines: list[str] = []
    for text in advised[: None if room is None else 3]:
        more = wrapped(text, look.width, initial_indent="→ ", subsequent_indent="  ")
        if room is None or not lines or len(lines) + len(more) <= room:
            lines += more[:room]
    return lines


def _errors(result: ResultShape, look: Look) -> list[str]:
    heads, rows = comparison(result)
    rows = [row for row in rows if row.kind != "p_value"]  # it stands in the first line
    # What has the least to say comes last, where lines are cut.
    rows.sort(key=lambda row: row.kind == "held_out")
    if not rows:
        return []
    if all(row.before is None for row in rows):
        return _columns([row.cells[::2] for row in rows], 14, look)
    return _columns([("", *heads), *(row.cells for row in rows)], 14, look)


def _columns(rows: Sequence[Sequence[str]], least: int, look: Look) -> list[str]:
    """Names to the left, and what each has to the right, in columns that never touch.

    Where they are too wide, names go on in a second line; where there is no room for that, they
    stand above what they have.
    """
    needed = [max(map(len, cells)) + 2 for cells in zip(*rows, strict=True)]
    room = look.width - 2
    first, wide = needed[0], [max(least, n) for n in needed[1:]]
    if first + sum(wide) > room:
        wide = needed[1:]
    if first + sum(wide) <= room:
        return [
            f"  {row[0]:{first}}" + "".join(f"{c:>{w}}" for c, w in zip(row[1:], wide, strict=True))
            for row in rows
        ]
    lines: list[str] = []
    left = room - sum(wide)
    if left >= NAME:
        for row in rows:
            cells = "".join(f"{c:>{w}}" for c, w in zip(row[1:], wide, strict=True))
            names = wrapped(row[0], left - 2, subsequent_indent="  ") or [""]
            lines.append(f"  {names[0]:{left}}{cells}")
            lines += [f"  {more}" for more in names[1:]]
        return lines
    for row in rows:
        lines += wrapped(row[0], room, initial_indent="  ", subsequent_indent="    ")
        cells = "".join(f"{c:>{w}}" for c, w in zip(row[1:], wide, strict=True))
        if len(cells) <= look.width:
            lines.append(f"{cells:>{look.width}}")
        else:
            lines += [f"{cell:>{look.width}}" for cell in row[1:]]
    return lines


def _found(result: TraceShape, look: Look) -> list[str]:
    lines: list[str] = []
    for step in result.steps if look.whole else result.steps[:4]:
        where = labelled(target_words("", step.target), step.label)
        line = _labelled("found", f"{name_of(step.term)} of {where}: {size_words(step)}")
        rms = step.platform_rms
        if rms is not None and rms.orientation is not None:
            cost = f"{number(rms.position, 2)} {result.length_unit}"
            extra = f"; platform {cost}, {number(rms.orientation, 2)} rad"
            line += extra if look.whole or len(line) + len(extra) <= max(look.width, WIDTH) else ""
        lines += _cut(line, look)
        if not step.applied:
            lines += _cut(f"            {not_applied(step)}", look)
        if step.also_fits:
            names = [f"{name_of(n.term)} of {target_words('', n.target)}" for n in step.also_fits]
            shown = names if look.whole else names[:3]
            more = "" if len(names) == len(shown) else f" and {len(names) - 3} more"
            lines += _cut(f"            fits as well: {', '.join(shown)}{more}", look)
        if step.curve_law is not None:
            lines += _cut(f"            {law_words(step.curve_law)}", look)
    law = None if result.unexplained is None else result.unexplained.law
    if lines and law is not None:
        likely = f"{100.0 * law.probability:.0f} % likely among formulas"
        words = (
            f"{law.formula} at {law.target}, {likely}; its lines are in unexplained.law of the JSON"
        )
        lines += _most(_entry("formula", words, look), 3, look)
    if words := elsewhere_words(result):
        lines += _most(_entry("elsewhere", words, look), 3, look)
    return lines if not lines or result.excluded else [*lines, ""]


def _left_out(result: ResultShape, look: Look) -> list[str]:
    lines = _listed("left out", left_out(result), 3, look)
    lines += _listed("noisier", noisier(result), 3, look)
    return [*lines, ""] if lines else []


def _left(result: TraceShape, look: Look) -> list[str]:
    if result.verdict == "implausible" or (result.verdict == "unexplained" and mistaken(result)):
        return []  # of readings of another mechanism nothing is left, and they hide nothing
    lines: list[str] = []
    # Where something is, it stands whole among what to do next.
    if result.unexplained is not None and result.unexplained.target is None:
        lines += _most(_entry("left over", result.unexplained.text, look), 2, look)
    for hidden in result.could_hide[: HIDDEN if look.whole else 1]:
        rms = hidden.platform_rms
        cost = (
            ""
            if rms is None
            else f", {number(rms.position, 2)} {result.length_unit} at {moved_words(rms)}"
        )
        size = f" up to {with_unit(number(hidden.detectable, 2), hidden.unit)}"
        if hidden.detectable is None:
            size = ", of any size: these poses do not show it"
        where = labelled(target_words("", hidden.target), hidden.label)
        at = f" at {hidden.place}" if hidden.place else ""
        name = f"{name_of(hidden.term)} of {where}{at}"
        lines += _cut(_labelled("may hide", f"{name}{size}{cost}"), look)
    if look.whole:
        lines += _listed("not tried", not_tried(result), 0, look)
    return ["", *lines] if lines else []


WIDER = 2.0
"""An interval from group to group that is so much wider than within them is shown beside it."""


def _parameters(result: ResultShape, room: int | None, look: Look) -> list[str]:
    """Offsets and gains side by side, by channel; then the others."""
    sensors: dict[str, dict[str, Parameter]] = {}
    others = []
    for p in result.parameters:
        if p.term in ("offset", "gain"):
            where = labelled(p.target, result.labels.get(p.target))
            sensors.setdefault(where, {})[p.term] = p
        else:
            others.append(p)
    lines = _sensors(sensors, look) if sensors else []
    for p in others:
        name = parameter_name(p.term, p.name)
        lines += _cut(f"  {p.target:9} {name} = {with_unit(_estimate(p), p.unit)}", look)
    if room is not None and len(lines) > room:
        lines = [*lines[: max(room - 1, 0)], f"  … {len(lines) - room + 1} more in the report"]
    return lines


def _sensors(sensors: Mapping[str, Mapping[str, Parameter]], look: Look) -> list[str]:
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
    return _columns(rows, 28, look)


def _unit(parameter: Parameter) -> str:
    """Gains of a converter are small: they are shown in thousandths."""
    return f"m{parameter.unit}" if parameter.unit == "rad/count" else parameter.unit


def _estimate(parameter: Parameter) -> str:
    scale = 1e3 if parameter.unit == "rad/count" else 1.0
    value = None if parameter.value is None else scale * parameter.value
    shown, half = with_bounds(parameter, scale)
    found = f"{shown} ({half})" if half[-1:].isdigit() and " " in half else f"{shown} ± {half}"
    wide = parameter.sd_between
    if wide is None or parameter.sd is None or wide < WIDER * parameter.sd:
        return found
    return f"{found} (± {plus_minus(value, HALF_95 * scale * wide)[1]} elsewhere)"
