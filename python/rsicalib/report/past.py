"""The history of a device: its data, as lines for a terminal, and as a page."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from rsicalib import _core
from rsicalib.facts.estimates import parameter_key
from rsicalib.facts.records import Record, to_json
from rsicalib.plain_text import counted
from rsicalib.plots import intervals, on_axes
from rsicalib.report.figure import Figure, whole
from rsicalib.report.page import FEW, document, listed, pictures, section, table
from rsicalib.report.residuals import FAR
from rsicalib.report.svg import WIDE, Axis, Canvas, Chart, bounds, fitted, width_of
from rsicalib.report.words import capital, number, plus_minus, probability
from rsicalib.tabular import Tabular, Told
from rsicalib.units import HALF_95, axis_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FORMAT = "rsicalib.history/1"

CourseKind: TypeAlias = Literal["still", "drift", "jump", "drift and jump"]
"""What a parameter has done."""

DRIFTING: frozenset[CourseKind | None] = frozenset(("drift", "drift and jump"))
"""Kinds with a rate that is worth its price."""

DAY_S = 86_400.0
YEAR = 365.25
"""Days: rates are shown per year."""

HEIGHT = 180.0


class Past(Record):
    """One result of the device."""

    file: str
    """Name of the file."""
    valid_from: str
    """Date from which it holds."""
    verdict: str
    """Its verdict."""
    found: tuple[str, ...]
    """Effects that were found, as `curvature@a22`."""
    note: str | None = None
    """What was noted of the session."""


class LeftOut(Record):
    """A file of the folder that is not part of the history."""

    file: str
    """Name of the file."""
    reason: str
    """Why."""


class Jump(Record):
    """A new level of a parameter: an event of the history."""

    valid_from: str
    """Date of the first result that has it."""
    value: float
    """How far the level jumped."""
    sd: float
    """Standard deviation of the jump."""
    told: bool
    """True where a result itself says that something changed there."""


class Series(Record):
    """One parameter over time."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    name: str
    """Name of the parameter."""
    unit: str
    """Unit of the values."""
    valid_from: tuple[str, ...]
    """When."""
    values: tuple[float, ...]
    """Estimates."""
    sd: tuple[float, ...]
    """Their standard deviations."""
    rate: float | None
    """Drift per day between the jumps; None with less than two dates."""
    rate_sd: float | None
    """Standard deviation of the rate, with the scatter that the estimates' own does not explain."""
    p_value: float | None
    """Probability of such a rate by chance."""
    place: str | None = None
    """Where a searched term acts: another channel, an order."""
    kind: CourseKind | None = None
    """What is worth its price; None as `rate`."""
    jumps: tuple[Jump, ...] = ()
    """New levels, by date."""
    level: float | None = None
    """Level at the last date: all results since the last jump."""
    level_sd: float | None = None
    """Its standard deviation."""
    scatter: float | None = None
    """Standard deviation between sessions beside that of the estimates; 0 where it is no more."""
    wide: float = HALF_95
    """Half width of an interval of 95 % of level and rate, in standard deviations."""

    @property
    def key(self) -> str:
        """Its name: `gain@a11`, `curvature@a22.c2`."""
        return parameter_key(_core.spec(self.term, self.target, self.place), self.term, self.name)


class Forecast(Record, repr=False):
    """When the platform's error will exceed a target under the last calibration."""

    target: float
    """Position, root mean square over components, in units of length."""
    now: float
    """Likely error on the day of the last calibration: what its uncertainty leaves."""
    day: str | None
    """The day from which the error is likely above the target; None: not within ten years."""
    from_day: str | None
    """The day by which one device in twenty like this one has exceeded it."""

    def __repr__(self) -> str:
        past = "not within ten years" if self.day is None else f"past {self.target:g} by {self.day}"
        return f"<Forecast: {number(self.now)} now, likely {past}>"


class History(Told, Tabular, Record, kw_only=True, repr=False):
    """What is known of one device over time."""

    format: str = FORMAT
    """Kind of the document and version of its shape."""
    device: str | None
    """The device, as results call it."""
    mechanism: str
    """Name of the mechanism."""
    length_unit: str
    """Unit of every length."""
    results: tuple[Past, ...]
    """The results, by date."""
    parameters: tuple[Series, ...]
    """What belongs to the device, over time."""
    session_only: tuple[str, ...]
    """Effects that belong to a session, and are not compared."""
    left_out: tuple[LeftOut, ...]
    """Files that are damaged, or of another device."""
    forecast: Forecast | None = None
    """With a target and a platform: when its error will exceed it. None of one result: it has no
    rate."""

    def to_json(self) -> str:
        """The history as JSON text."""
        return to_json(self.to_dict())

    def text(self) -> str:
        """The history as lines for a terminal."""
        return "\n".join(lines(self))

    def page(self) -> str:
        """The history as one HTML page that needs no network."""
        return page(self)

    def plot(self, parameter: str | None = None, *, ax: Axes | None = None) -> Axes:
        """Draw a parameter over time with its 95 % intervals; needs matplotlib (`rsicalib[plot]`).

        Parameters
        ----------
        parameter : str, optional
            `offset@a22`, `curvature@a22.c2`; where not given the one whose drift is least likely
            by chance.
        ax : Axes, optional
            Where to; a new figure where not given.

        Returns
        -------
        Axes
            For titles and limits of your own.

        Raises
        ------
        KeyError
            There is no such parameter.
        """
        known = {one.key: one for one in self.parameters}
        if parameter is None:
            parameter = min(known, key=lambda key: _by_chance(known[key]))
        if parameter not in known:
            raise KeyError(f"no parameter {parameter!r}; there are {', '.join(known)}")
        one = known[parameter]
        days = [datetime.datetime.fromisoformat(date) for date in one.valid_from]
        half = [HALF_95 * sd for sd in one.sd]
        axes = on_axes(ax, figsize=(7, 3))
        intervals(axes, days, one.values, half, axis_words(parameter, one.unit))
        axes.tick_params(axis="x", rotation=30)
        return axes

    def _table(self) -> dict[str, Any]:
        rows = [
            (one.key, *row, one.unit)
            for one in self.parameters
            for row in zip(one.valid_from, one.values, one.sd, strict=True)
        ]
        names = ("name", "valid_from", "value", "sd", "unit")
        return dict(zip(names, zip(*rows, strict=True), strict=True)) if rows else {}

    def __repr__(self) -> str:
        drifting = ", ".join(one.key for one in _drifts(self)) or "nothing"
        drifts = "no rate" if _no_rate(self) else f"{drifting} drifts"
        results = counted(len(self.results), "result")
        jumps = "".join(f", {one.key} jumped" for one in self.parameters if one.jumps)
        called = self.device or self.mechanism
        return f"<History of {called!r}: {results}, {drifts}{jumps}>"


def lines(history: History) -> list[str]:
    """The history as lines."""
    first, last = history.results[0], history.results[-1]
    called = history.device or history.mechanism
    results = counted(len(history.results), "result")
    out = [
        f"{called}: {results}, {first.valid_from} to {last.valid_from}",
        "",
        *(_past(one) for one in history.results),
    ]
    if history.parameters:
        out += ["", *_aligned(history.parameters)]
    names = ", ".join(f"{s.term}@{s.target}" for s in _drifts(history))
    out += ["", _no_rate(history) or f"drifts beyond chance: {names or 'none'}"]
    out += [event_words(one, jump) for one in history.parameters for jump in one.jumps]
    out += [scatter_words(one) for one in history.parameters if one.scatter]
    if history.session_only:
        out.append(f"of single sessions, not compared: {', '.join(history.session_only)}")
    if history.forecast is not None:
        out += ["", forecast_words(history, history.forecast)]
    if history.left_out:
        out += ["", "left out:", *(f"  {one.file}: {one.reason}" for one in history.left_out)]
    return out


def _by_chance(one: Series) -> float:
    return 1.0 if one.p_value is None else one.p_value


def _past(one: Past) -> str:
    found = f", {', '.join(one.found)}" if one.found else ""
    note = f" ({one.note})" if one.note else ""
    return f"  {one.valid_from}  {one.verdict}{found}{note}  {one.file}"


def _cells(one: Series) -> list[str]:
    name = axis_words(one.key, one.unit)
    value, half = plus_minus(one.values[-1], HALF_95 * one.sd[-1])
    rate, rate_half = "-", "-"
    if one.rate is not None and one.rate_sd is not None:
        rate, rate_half = plus_minus(YEAR * one.rate, one.wide * YEAR * one.rate_sd)
    return [name, value, half, rate, rate_half]


def _aligned(parameters: Sequence[Series]) -> list[str]:
    """Parameters as lines, each column as wide as its longest cell."""
    rows = [["parameter", "last", "± 95 %", "per year", "± 95 %"], *map(_cells, parameters)]
    wide = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(f"{cell:{'>' if k else '<'}{wide[k]}}" for k, cell in enumerate(row))
        for row in rows
    ]


def _row(one: Series) -> list[str]:
    """The same for a page: values with their bounds."""
    name, last, half, rate, rate_half = _cells(one)
    yearly = "–" if one.rate is None else f"{rate} ± {rate_half}"
    chance = "–" if one.p_value is None else probability(one.p_value)
    return [name, f"{last} ± {half}", yearly, chance]


def _drifts(history: History) -> list[Series]:
    """Parameters with a rate that is worth its price, the number of parameters counted in."""
    return [s for s in history.parameters if s.kind in DRIFTING]


def _no_rate(history: History) -> str | None:
    """Why nothing has a rate; None where any parameter was estimated on two dates."""
    if any(one.rate is not None for one in history.parameters):
        return None
    if history.parameters or not history.session_only:
        return "no rate and no forecast: both need a second result, of a later date"
    return "no rate and no forecast: no parameter of these results outlasts its session"


def event_words(one: Series, jump: Jump) -> str:
    """A jump as a line."""
    value, half = plus_minus(jump.value, HALF_95 * jump.sd)
    told = ", as its result says" if jump.told else ""
    return f"jumped: {one.key} by {value} ± {half} {one.unit} by {jump.valid_from}{told}"


def scatter_words(one: Series) -> str:
    """Scatter as a line."""
    return (
        f"scatters: {one.key} by {number(one.scatter)} {one.unit} from session to session, "
        "beside what its results state"
    )


def forecast_words(history: History, forecast: Forecast) -> str:
    """When the error of the platform will exceed the target, as a sentence.

    Where no drift is beyond chance, it rests on what the results leave open of the rates.
    """
    unit = history.length_unit
    text = f"platform error now {number(forecast.now)} {unit}, "
    if forecast.now > forecast.target:
        return f"{text}above the target of {number(forecast.target)} {unit} already"
    if forecast.day is None:
        text += f"not likely above {number(forecast.target)} {unit} within ten years"
    else:
        text += f"likely above {number(forecast.target)} {unit} by {forecast.day}"
    if forecast.from_day is not None:
        text += f" (in one case of twenty by {forecast.from_day})"
    if not _drifts(history):
        text += "; no drift is beyond chance: this is what the uncertainty of the rates allows"
    return text


def page(history: History) -> str:
    """The history as one HTML page."""
    called, last = history.device or history.mechanism, history.results[-1].valid_from
    words = lines(history)[0]
    drifts = _drifts(history)
    drifting = ", ".join(f"{s.term} of {s.target}" for s in drifts)
    events = [event_words(one, jump) for one in history.parameters for jump in one.jumps]
    still = "Nothing drifts and nothing jumped beyond chance."
    if unrated := _no_rate(history):
        still = f"{capital(unrated)}."
    if drifts or events:
        still = "" if drifts else "Nothing drifts beyond chance."
    verdict = f"{words}. " + (f"Drifting: {drifting}." if drifts else still)
    late = history.forecast is not None and history.forecast.now > history.forecast.target
    scattered = [scatter_words(one) for one in history.parameters if one.scatter]
    if scattered:
        verdict += f" From session to session {counted(len(scattered), 'parameter')} scattered."
    mood = "bad" if drifts or events or scattered or late else "good"
    parts = [
        "<h1>History of a calibration</h1>",
        f'<p class="verdict {mood}">{whole(escape(verdict))}</p>',
    ]
    if history.forecast is not None:
        forecast = forecast_words(history, history.forecast)
        parts.append(f"<p>{whole(escape(forecast[0].upper() + forecast[1:]))}.</p>")
    for many, told in (("jumps", events), ("parameters that scatter", scattered)):
        said = listed(f"{line[0].upper()}{line[1:]}." for line in told)
        if len(told) > FEW:
            said = f"<details><summary>{len(told)} {many}</summary>\n{said}</details>"
        parts.append(said)
    rows = [
        (one.valid_from, one.verdict, ", ".join(one.found), one.note or "", one.file)
        for one in history.results
    ]
    names = ("date", "verdict", "found", "note", "file")
    used = [k for k in range(len(names)) if any(row[k] for row in rows)]
    heads = [names[k] for k in used]
    filled = [[row[k] for k in used] for row in rows]
    results = f"<h3>Results</h3>\n{table(heads, filled, text=len(heads), words='results')}"
    both = f'<div class="choose"><div>{_sparklines(history)}</div>\n<div>{results}</div></div>'
    parts.append(section("Over time", both))
    columns = ("parameter", "last, ± 95 %", "per year, ± 95 %", "by chance")
    cells = [_row(one) for one in history.parameters]
    parts.append(section("Parameters", table(columns, cells, words="parameters", wide=True)))
    each = pictures(map(_figure, history.parameters))
    if each:
        words = "Each parameter by itself, with 95 % intervals"
        parts.append(f"<details><summary>{words}</summary>\n{each}</details>")
    rows_out = [(one.file, one.reason) for one in history.left_out]
    if rows_out:
        parts.append(section("Left out", table(("file", "why"), rows_out, text=2)))
    return document(f"{called}: history", parts, f"History of {called}, to {last}")


ROW = 26.0
"""Height of a parameter in the grid."""

LEAST = 6
"""Letters of a note that are worth writing."""

REACH = 4.0
"""Standard deviations that a row has room for, at least, up and down."""


def _sparklines(history: History) -> str:
    """All parameters in one grid: each in its own standard deviations, events marked."""
    shown = history.parameters
    if not shown:
        return ""
    days = [days_of(date) for one in shown for date in one.valid_from]
    first, last = min(days), max(max(days), min(days) + 1.0)

    def draw(width: float) -> str:
        left = 150.0 if width == WIDE else 104.0
        canvas = Canvas(width, ROW * len(shown) + 34.0)
        x = Axis(first, last, left, width - 14.0)
        bottom = ROW * len(shown)
        for past in history.results:
            at = x(days_of(past.valid_from))
            canvas.line(at, 0.0, at, bottom, "grid")
        _events(canvas, history, x, bottom + 7.0)
        for k, one in enumerate(shown):
            middle, usual = float(np.median(one.values)), float(np.median(one.sd)) or 1.0
            far = [(value - middle) / usual for value in one.values]
            reach = max(REACH, *(abs(z) for z in far))
            y = Axis(-reach, reach, ROW * (k + 1) - 4.0, ROW * k + 4.0)
            canvas.text(left - 6.0, y(0.0) + 4.0, fitted(one.key, left - 8.0), anchor="end")
            canvas.rect(left, y(2.0), width - 14.0 - left, y(-2.0) - y(2.0), "noise")
            along = [x(days_of(date)) for date in one.valid_from]
            canvas.path(list(zip(along, map(y, far), strict=True)), "law thin")
            for px, date, value, z in zip(along, one.valid_from, one.values, far, strict=True):
                said = f"{one.key}, {date}: {value:g} {one.unit}, {z:+.1f} sd from the median"
                canvas.dot(px, y(z), 2.2, "dot far" if abs(z) > FAR else "dot", said)
            for jump in one.jumps:
                px = x(days_of(jump.valid_from))
                canvas.line(px, ROW * k + 1.0, px, ROW * (k + 1) - 1.0, "law jump")
        for words, px, anchor in (
            (min(one.valid_from[0] for one in shown), left, "start"),
            (max(one.valid_from[-1] for one in shown), width - 14.0, "end"),
        ):
            canvas.text(px, canvas.height - 4.0, words[:10], anchor=anchor)
        return canvas.svg("all parameters over time, in standard deviations from the median")

    caption = (
        "Each row is a parameter in standard deviations of one of its estimates from its median; "
        f"the band is ± 2, dots beyond {FAR:g} are red."
    )
    if any(one.jumps for one in shown):
        caption += " A red line is a jump."
    if any(past.note or past.found for past in history.results):
        caption += " Rings below are results with a note, or with an effect that was found."
    return Figure("sparklines", draw, caption).html()


def _events(canvas: Canvas, history: History, x: Axis, y: float) -> None:
    """A ring for each result with a note or an effect, with its words where there is room."""
    told = [
        (
            x(days_of(past.valid_from)),
            past.valid_from,
            ", ".join(filter(None, [past.note, *past.found])),
        )
        for past in history.results
        if past.note or past.found
    ]
    afters = [*(at for at, _, _ in told[1:]), canvas.width]
    free = 0.0
    for (at, day, words), after in zip(told, afters, strict=False):
        canvas.dot(at, y, 3.0, "ring", f"{day}, {words}")
        left, right = at - free, after - at
        shown = fitted(words, max(left, right) - 14.0)
        free = at + 7.0
        if len(shown) < LEAST:
            continue
        if right >= left:
            canvas.text(at + 7.0, y + 4.0, shown)
            free += width_of(shown)
        else:
            canvas.text(at - 7.0, y + 4.0, shown, anchor="end")


def _figure(one: Series) -> Figure:
    days = [days_of(date) for date in one.valid_from]
    since = [day - days[0] for day in days]
    half = [HALF_95 * sd for sd in one.sd]
    title = f"{one.term} of {one.target}"
    title += f", {one.name}" if one.name != one.term else ""

    def draw(width: float) -> str:
        canvas = Canvas(width, HEIGHT)
        ends = [v + s * h for v, h in zip(one.values, half, strict=True) for s in (-1.0, 1.0)]
        words = f"days since {one.valid_from[0]}", axis_words("estimate", one.unit)
        chart = Chart.on(canvas, bounds(since), bounds(ends), words, height=HEIGHT)
        for day, value, h, date in zip(since, one.values, half, one.valid_from, strict=True):
            (x, low), (_, high) = chart.at((day, value - h)), chart.at((day, value + h))
            canvas.line(x, low, x, high, "whisker")
            canvas.dot(*chart.at((day, value)), said=f"{date}: {value:g} ± {h:.2g}")
        return canvas.svg(title)

    name = re.sub(r"\W+", "-", f"{one.term}-{one.target}-{one.name}")
    return Figure(name, draw, f"{title}, with 95 % intervals.")


def days_of(date: str) -> float:
    """A date in days since 1970; in UTC where it says no zone."""
    when = datetime.datetime.fromisoformat(date)
    if when.tzinfo is None:
        when = when.replace(tzinfo=datetime.UTC)
    return when.timestamp() / DAY_S
