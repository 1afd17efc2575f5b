"""Reports: what they say, that they need no network, and that they hold for any result."""

from __future__ import annotations

import dataclasses
import itertools
import pickle
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Calibration, Mechanism, Parameter, Trace, _core
from rsicalib.facts.records import plain, to_json
from rsicalib.facts.shapes import Excluded, Name, Noise, Reason, Unexplained
from rsicalib.facts.warned import Warned
from rsicalib.io.readings import Readings
from rsicalib.report import residuals, svg
from rsicalib.report.checks import noise_figure
from rsicalib.report.figure import Figure
from rsicalib.report.mechanism import scene_of
from rsicalib.report.plain import plain_words
from rsicalib.report.residuals import residual_figure
from rsicalib.report.svg import SIZE, width_of
from rsicalib.report.terminal import summary
from rsicalib.report.words import (
    advice,
    count_words,
    noise_words,
    number,
    plus_minus,
    sentence,
    target_words,
)
from rsicalib.report.workspace import Shades, workspace_figure
from rsicalib.results.result import Result
from rsicalib.units import with_unit
from rsicalib.work.arguments import Bare
from tests.families.device import Effect, Scene, observe
from tests.families.trials import readings_of
from tests.oracle import Array
from tests.test_families import clean

READINGS, REST, CHECK = (DEMO / f"{name}.csv" for name in ("readings", "rest", "check"))


SVG = "http://www.w3.org/2000/svg"
ARMS = [{(f"a{n}1", f"a{n}2"), (f"a{n}2", f"a{n}3"), (f"a{n}3", f"wrist{n}")} for n in (1, 2, 3)]
"""Bodies of the arms."""
HEADS = ["offset [rad]", "gain [mrad/count]"]
LONG = "shoulder_of_arm_"
"""Longer than a column."""


@pytest.fixture(scope="module")
def traced() -> Trace:
    return rsicalib.demo()


RESULTS: list[Callable[[], Result]] = [
    rsicalib.demo,
    lambda: rsicalib.calibrate(READINGS),
    lambda: rsicalib.calibrate(READINGS, rest=REST, check=CHECK, align=True),
    lambda: rsicalib.calibrate(READINGS, calibration=rsicalib.calibrate(READINGS)),
    lambda: rsicalib.calibrate(some(lambda whole: whole.pose < 5)),
    lambda: rsicalib.trace(some(lambda whole: (whole.pose < 5) & (whole.sample == 1))),
    lambda: rsicalib.trace(some(lambda whole: whole.sample == 1)),
    lambda: rsicalib.fixture(CHECK, check=CHECK),
]


def some(which: Callable[[Readings], Any]) -> Readings:
    """Some rows of the session of the package."""
    whole = rsicalib.load_readings(READINGS)
    return whole.select(which(whole))


class Balance(HTMLParser):
    """Every element is closed in its turn, and nothing is fetched from elsewhere."""

    EMPTY = ("meta", "input")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert not {"src", "href", "srcset"} & {name for name, _ in attrs}
        assert tag not in ("link", "img", "iframe")
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """An element of a figure that closes itself."""

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.EMPTY:
            assert self.open.pop() == tag


@pytest.mark.parametrize("made", RESULTS)
def test_every_kind_of_result_has_a_report_and_a_summary(made: Callable[[], Result]) -> None:
    result = made()
    page = result.report()
    reader = Balance()
    reader.feed(page)
    assert reader.open == []
    assert "nan" not in re.sub(r"<[^>]*>", " ", page).lower().split()
    assert "url(" not in page and "@import" not in page
    lines = result.summary().splitlines()
    assert len(lines) <= 25
    assert max(map(len, lines)) <= 100
    assert sentence(result).split()[0] in lines[0]


def test_the_report_says_all_that_was_promised(traced: Trace) -> None:
    page = traced.report()
    titles = re.findall("<h2>(.*?)</h2>", page)
    assert titles == [
        "Error before and after",
        "What to do next",
        "What is left, pose by pose",
        "What was found",
        "What if it were something else?",
        "Over the workspace",
        "Parameters",
        "Readings",
        "What could hide",
        "How",
    ]
    assert "curvature of sensor a22" in page
    assert "prefers-color-scheme: dark" in page and "@media print" in page
    assert len(page.encode()) < 1e6


def test_device_date_and_note_stand_at_the_top(traced: Trace) -> None:
    named = dataclasses.replace(traced, device="no. 7", note="new pot", valid_from="2025-03-01")
    head = named.report().partition('class="verdict')[0]
    assert "no. 7" in head and "2025-03-01" in head
    assert "<p>new pot</p>" in named.report().partition("</header>")[0]


def test_a_result_that_was_read_from_a_file_has_a_report_with_fewer_pictures(
    traced: Trace, tmp_path: Path
) -> None:
    traced.save(tmp_path / "result.json")
    read = rsicalib.load_calibration(tmp_path / "result.json")
    assert read.evidence is None
    assert set(read.figures()) == {"effect1-law"}
    assert "<figure" in read.report()


def test_a_result_is_pickled_without_the_source_of_its_evidence(traced: Trace) -> None:
    again = pickle.loads(pickle.dumps(traced))
    assert again.source is None and again.to_json() == traced.to_json()


def test_figures_are_svg_files_of_their_own(traced: Trace) -> None:
    for name, text in traced.figures().items():
        root = ET.fromstring(text)
        assert root.tag == "{http://www.w3.org/2000/svg}svg", name
        assert "prefers-color-scheme: dark" in text


def dots_of(figure: Figure | None, width: float) -> list[ET.Element]:
    assert figure is not None
    root = ET.fromstring(figure.draw(width))
    return [e for e in root.iter() if e.get("class", "").split(" ")[0] == "dot"]


@pytest.mark.parametrize("width", [svg.NARROW, svg.WIDE])
def test_a_dot_is_drawn_for_every_closure_of_every_pose(traced: Trace, width: float) -> None:
    assert len(dots_of(residual_figure(traced, traced.evidence), width)) == 2 * 48 * 3


def test_a_recording_is_drawn_in_blocks_that_keep_their_size_in_units_of_noise(
    traced: Trace,
) -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(4000, 3))
    long = dataclasses.replace(traced, before_residuals=noise, after_residuals=noise)
    figure = residual_figure(long)
    assert 2 * 250 * 3 < len(dots_of(figure, svg.WIDE)) <= 2 * 300 * 3
    dots = residuals.dots_of(long, None)
    assert dots is not None
    # The mean square of 286 blocks of three normal residuals is 1 within 4 of its deviations.
    assert np.mean(dots.blocks(noise) ** 2) == pytest.approx(1.0, abs=4 * (2 / 858) ** 0.5)


def test_the_readings_ask_for_the_law_that_was_simulated() -> None:
    """Witness: what was simulated, as `demo/README.md` says."""
    found = rsicalib.demo()
    assert found.evidence is not None
    law = found.evidence.effects[0].law
    assert law is not None and law.over == "reading of a22" and law.unit == "count"
    x, asked, sd = np.array(law.dots).T
    u = (x - 2047.5) / 2047.5
    # Offset and gain of the channel take up a line: what is left is the parabola.
    columns = np.column_stack([np.ones_like(u), u, u**2]) / sd[:, None]
    (_, _, c2), *_ = np.linalg.lstsq(columns, asked / sd, rcond=None)
    readme = (DEMO / "README.md").read_text()
    size = float(re.findall(r"([+-][0-9.]+) rad at 1000 counts from the middle", readme)[0])
    sd = found.steps[0].parameters[0].sd
    assert sd is not None
    assert c2 == pytest.approx(size * 2.0475**2, abs=4 * sd)
    assert {a.effect.term for a in law.alternatives} == {n.term for n in found.steps[0].also_fits}


def test_a_calibration_that_left_a_reading_out_can_take_it_back() -> None:
    whole = rsicalib.load_readings(READINGS)
    values = whole.values.copy()
    values[whole.pose == 17, 2] += 60.0
    found = rsicalib.calibrate(dataclasses.replace(whole, values=values), rest=REST)
    assert found.evidence is not None and found.evidence.switchboard is not None
    board = found.evidence.switchboard
    assert [(s.pose, s.channel) for s in board.switches] == [(17, "a13")]
    assert found.with_excluded is not None
    expected = found.with_excluded.fit.chi2, found.fit.chi2
    # Means of samples instead of samples: to second order in the noise the same.
    assert [fit.chi2 for fit in board.fits] == pytest.approx(expected, rel=0.01)
    assert "<h2>What if it were something else?</h2>" in found.report()


def test_labels_of_the_worst_dots_stay_in_their_panel(traced: Trace) -> None:
    rows = np.zeros((48, 3))
    rows[40:] = -9.0 + 0.1 * np.arange(24).reshape(8, 3)
    bad = dataclasses.replace(traced, before_residuals=rows, after_residuals=rows)
    figure = residual_figure(bad)
    assert figure is not None
    for width in (svg.NARROW, svg.WIDE):
        root = ET.fromstring(figure.draw(width))
        labels = [e for e in root.iter() if e.get("class") == "culprit"]
        heights = [float(e.get("y", "nan")) for e in labels]
        assert len(labels) == 6
        assert all(0.0 < y < 170.0 for y in heights[:3])  # above the axis of the first panel
        assert all(200.0 < y < 370.0 for y in heights[3:])
        assert min(abs(a - b) for a, b in itertools.combinations(heights, 2)) >= 12.9


@pytest.mark.parametrize("width", [svg.NARROW, svg.WIDE])
def test_every_label_stands_beside_its_dot_or_is_led_to_it(traced: Trace, width: float) -> None:
    rows = np.tile([2.0, -2.0, 0.0], (48, 1))
    rows[[0, 3, 4], 1] = -5.0, -5.2, -5.1  # beside one another, at the lower end
    bad = dataclasses.replace(traced, before_residuals=None, after_residuals=rows)
    figure = residual_figure(bad)
    assert figure is not None
    root = ET.fromstring(figure.draw(width))

    def numbers(found: list[ET.Element], name: str) -> Array:
        return np.array([float(e.get(name, "nan")) for e in found])

    labels = [e for e in root.iter() if e.get("class") == "culprit"]
    dots = [e for e in root.iter() if "far" in (e.get("class") or "").split()]
    led = [e for e in root.iter() if e.get("class") == "leader"]
    axes = [e for e in root.iter() if e.get("class") == "axis"]
    assert len(dots) == 3 and len(labels) > 1
    high = numbers(labels, "y")
    assert np.all(high < numbers(axes[:1], "y1")), "numbers of the axis are below"
    off = np.abs(high[:, None] - 4.0 - numbers(dots, "cy")).min(axis=1)
    assert 0 < np.sum(off > 0.1) <= len(led) <= len(labels)
    ends = {(d.get("cx"), d.get("cy")) for d in dots}
    starts = {(e.get("x1"), e.get("y1")) for e in led}
    assert starts <= ends


def test_what_an_effect_explains_is_a_line_of_slope_one(traced: Trace) -> None:
    assert traced.evidence is not None
    effect = traced.evidence.effects[0]
    x, y = np.array(effect.added_variable).T
    slope = float(x @ y / (x @ x))
    # The sum of squares that the effect explains is its rise of χ², to first order.
    assert slope == pytest.approx(1.0, abs=0.02)
    assert traced.steps[0].chi2_rise == pytest.approx(x @ x, rel=0.05)


@pytest.mark.parametrize(("target", "part"), [(1e-9, False), (1e9, False), (None, True)])
def test_a_line_of_the_target_is_told_where_it_is_drawn(
    traced: Trace, target: float | None, *, part: bool
) -> None:
    assert traced.evidence is not None
    cells = [cell[2] for one in traced.evidence.workspace for cell in one.cells]
    figure = workspace_figure(traced, traced.evidence, target or float(np.median(cells)))
    assert figure is not None
    assert ("contour" in figure.draw(svg.WIDE)) == part
    assert ("The line" in figure.caption) == part


def test_a_page_calls_parts_of_each_chain_by_words(traced: Trace) -> None:
    """As the result calls them: `each/4`, `each.2`."""
    coded = {h.target for h in traced.could_hide if re.match(r"each[./]", h.target)}
    assert coded
    page = traced.report()
    hide = page[page.index("<h2>What could hide</h2>") :]
    first = page[: page.index("<h2>What is left, pose by pose</h2>")]
    for said in (hide, re.sub(r"(?s)<svg.*?</svg>|<script.*?</script>", "", first)):
        assert not re.search(r"each[./]\d", said)
        assert "of each chain" in said
    assert target_words("sensor", "each.2") != target_words("closure", "each.2")


def test_degrees_of_freedom_are_whole_where_they_are() -> None:
    assert [count_words(dof) for dof in (74.0, 1250.0, 74.25, None)] == ["74", "1250", "74.2", "–"]


def test_the_winner_of_the_scores_is_what_was_named(traced: Trace) -> None:
    assert traced.evidence is not None
    scores = traced.evidence.effects[0].scores
    assert [s.charged for s in scores] == sorted((s.charged for s in scores), reverse=True)
    chosen = {(s.effect.term, s.effect.target) for s in scores if s.chosen}
    step = traced.steps[0]
    assert chosen == {(n.term, n.target) for n in (step, *step.also_fits)}
    assert scores[0].chosen
    assert traced.evidence.left[0].p_value > 0.01


def test_an_error_of_the_detectable_size_moves_parameters_as_the_external_reliability_says() -> (
    None
):
    """Witness: the readings themselves, one of them wrong."""
    whole = rsicalib.load_readings(READINGS)
    fitted = rsicalib.calibrate(READINGS, rest=REST, terms=["offset", "gain", "curvature@a22"])
    assert fitted.evidence is not None
    reliability = fitted.evidence.reliability
    assert reliability is not None
    pose, channel = 20, 4
    error = reliability.detectable[channel][pose]
    external = reliability.external[channel][pose]
    assert error is not None and external is not None
    values = whole.values.copy()
    label = list(dict.fromkeys(whole.pose.tolist()))[pose]
    # A quarter of it, which is not left out: to first order all is in proportion.
    values[whole.pose == label, channel] += error / 4
    moved = rsicalib.calibrate(
        dataclasses.replace(whole, values=values),
        rest=REST,
        terms=["offset", "gain", "curvature@a22"],
    )
    shift = moved.values - fitted.values
    # √(Δᵀ C⁻¹ Δ): the largest shift of any combination in its standard deviations.
    size = float(np.sqrt(shift @ np.linalg.solve(fitted.covariance, shift)))
    assert size == pytest.approx(external / 4, rel=0.01)


def test_the_mechanism_is_drawn_closed_and_uncertain_as_forward_says(traced: Trace) -> None:
    assert traced.evidence is not None and traced.evidence.drawing is not None
    drawing = traced.evidence.drawing
    nodes = np.array(drawing.at).reshape(len(drawing.at), -1, 3)
    wrists = [k for k, node in enumerate(drawing.nodes) if not node.joint]
    joined = [edge for edge in drawing.edges if set(edge) <= set(wrists)]
    assert len(wrists) == len(joined) == 3
    for a, b in joined:
        apart = np.linalg.norm(nodes[:, a] - nodes[:, b], axis=1)
        np.testing.assert_allclose(apart, 1.5 * 3**0.5, rtol=1e-6)  # l4 √3, Table I
    np.testing.assert_allclose(nodes[:, wrists].mean(axis=1), drawing.places, atol=1e-9)  # (3)
    # The longest axis of a covariance lies between its largest deviation and the root of its trace.
    # `forward_sd` differentiates along other directions, at single samples instead of their mean.
    sd = rsicalib.forward_sd(READINGS, "rsi", traced)[::8, :3]
    longest = np.linalg.norm(drawing.weakest, axis=1)
    assert np.all(longest > 0.98 * sd.max(axis=1))
    assert np.all(longest < 1.02 * np.linalg.norm(sd, axis=1))


def test_the_workspace_is_as_certain_as_forward_says(traced: Trace) -> None:
    assert traced.evidence is not None
    first, second = traced.evidence.workspace
    assert (first.axes, first.fixed, second.axes) == (("x", "y"), "z", ("x", "z"))
    for one, column in ((first, 1), (second, 2)):
        cells = np.array(one.cells)[::20]
        poses = np.zeros((len(cells), 6))
        poses[:, 0], poses[:, column], poses[:, 3 - column] = cells[:, 0], cells[:, 1], one.value
        names = [f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
        offset, gain = (
            np.array([traced[f"{term}@{name}"].value for name in names], dtype=float)
            for term in ("offset", "gain")
        )
        counts = (rsicalib.inverse(poses) - offset) / gain
        readings = Readings.from_arrays(rsicalib.load_mechanism("rsi"), counts)
        sd = rsicalib.forward_sd(readings, "rsi", traced)[:, :3]
        expected = np.sqrt((sd**2).mean(axis=1))
        np.testing.assert_allclose(cells[:, 2], expected, rtol=0.05)


def test_a_number_has_the_same_colour_in_every_report_of_a_mechanism(traced: Trace) -> None:
    fewer = rsicalib.calibrate(some(lambda whole: whole.pose < 30), rest=REST)
    assert traced.evidence is not None and fewer.evidence is not None
    mine, others = Shades(traced.evidence.workspace), Shades(fewer.evidence.workspace)
    assert mine.edges == others.edges
    # A shade ends at 1, 1.5, 2, 3, 5 and 7 of each power of ten.
    ten = mine.of(0.001)
    assert [mine.of(v) - ten for v in (0.00099, 0.0014, 0.0016, 0.0021, 0.0049, 0.01)] == [
        *(-1, 0, 1, 2, 3, 6),
    ]
    for result, shades in ((traced, mine), (fewer, others)):
        drawn = ET.fromstring(result.figures()["workspace"])
        cells = [r for r in drawn.iter(f"{{{SVG}}}rect") if len(r)]
        assert len(cells) > 100
        for cell in cells:
            said = float(str(cell[0].text).split(": ")[1].split()[0])
            # What is said has three digits: at an edge it may be of the next shade.
            near = {shades.of(said * (1 + e)) for e in (-0.005, 0.005)}
            assert int(cell.get("class", "").removeprefix("sd")) in near


def test_the_target_is_a_line_between_what_reaches_it_and_what_does_not(traced: Trace) -> None:
    assert traced.evidence is not None
    values = sorted(c[2] for one in traced.evidence.workspace for c in one.cells)
    target = values[len(values) // 3]
    drawn = ET.fromstring(traced.figures(target=target)["workspace"])
    lines = [e for e in drawn.iter(f"{{{SVG}}}line") if e.get("class") == "contour"]
    expected = 0
    for one in traced.evidence.workspace:
        places = np.array([c[:2] for c in one.cells])
        within = np.array([c[2] <= target for c in one.cells])
        for step in ((one.step[0], 0.0), (0.0, one.step[1])):
            gap = np.abs(places[:, None] + step - places).max(axis=2)
            first, second = np.nonzero(gap < 1e-6)
            expected += int((within[first] != within[second]).sum())
    assert len(lines) == expected > 0
    share = 100.0 * sum(v <= target for v in values) / len(values)
    said = re.sub(r"<[^>]+>", "", traced.report(target=target))
    assert f"{share:.0f} % of what is drawn" in said
    assert "contour" not in traced.figures()["workspace"].partition("</style>")[2]


@pytest.mark.parametrize(
    ("klass", "target", "edges"),
    [
        # A row is marked with its chain: the drawing does not tell rows.
        ("geometry", "arm2/2", ARMS[1]),
        ("geometry", "each/2", ARMS[0] | ARMS[1] | ARMS[2]),
        ("geometry", "arm1", ARMS[0]),
        ("sensor", "a22", set()),
        ("sensor", "each.2", set()),
        ("electronics", "all", set()),
    ],
)
def test_what_is_at_fault_is_marked_where_it_sits(
    traced: Trace, klass: str, target: str, edges: set[tuple[str, str]]
) -> None:
    assert traced.evidence is not None
    step = dataclasses.replace(traced.steps[0], klass=klass, target=target)
    scene = scene_of(dataclasses.replace(traced, steps=(step,)), traced.evidence)
    assert scene is not None
    names = [node.name for node in scene.drawing.nodes]
    marked = {tuple(sorted(names[k] for k in edge)) for edge in scene.edges(culprit=True)}
    assert marked == edges
    joints = {"a22": {"a22"}, "each.2": {"a12", "a22", "a32"}}.get(target, set())
    assert {names[k] for k in scene.faults.nodes if names[k] == scene.faults.nodes[k]} == joints
    # Something is written beside whatever has a place.
    assert bool(scene.faults.nodes) == (target != "all")


def test_an_error_that_has_not_changed_has_one_column() -> None:
    made = rsicalib.simulate(seed=1, poses=30)
    found = rsicalib.trace(made.readings, rest=made.rest, check=made.check)
    assert found.verdict == "adequate"
    page = found.report()
    assert "<h2>Error</h2>" in page and "Error before and after" not in page
    (row,) = (line for line in found.summary().splitlines() if "misclosure, rms" in line)
    assert len(re.findall(r"[0-9.]+", row)) == 1


@pytest.mark.parametrize("family", ["ballbar", "fivebar", "drawwire", "rps"])
def test_carried_points_are_as_certain_as_forward_says_wherever_joints_allow(family: str) -> None:
    """Witness: `workspace`, which applies the saved parameters and covariance by name.

    The report is drawn from the fit to the mean of the samples: to second order in the noise it is
    that of all samples.
    """
    found, mechanism = calibrated(family)
    assert found.evidence is not None
    # The very configurations, 1500 of the seed 11: a cell is the mean square over its own.
    space = rsicalib.workspace(found, mechanism, poses=1500, seed=11)
    for one in found.evidence.workspace:
        point = "" if one.of is None else f"{one.of}."
        columns = [space.names.index(f"{point}{axis}") for axis in ("x", "y", "z")]
        places, square = space.poses[:, columns], (space.sd[:, columns] ** 2).mean(axis=1)
        plane = places[:, ["xyz".index(axis) for axis in one.axes]]
        low, step = plane.min(axis=0), np.array(one.step)
        own = np.minimum((plane - low) // step, np.ceil(np.ptp(plane, axis=0) / step - 1e-9) - 1)
        for u, v, sd in one.cells[:: max(1, len(one.cells) // 20)]:
            inside = (own == ((u, v) - low) // step).all(axis=1)
            assert sd == pytest.approx(np.sqrt(square[inside].mean()), rel=2e-3)
    weakest = found.evidence.weakest
    assert weakest is not None and weakest.sd == pytest.approx(np.sqrt(square.max()), rel=2e-3)


def calibrated(family: str) -> tuple[Calibration, Mechanism]:
    _, _, mechanism, readings = clean(family)
    return rsicalib.calibrate(readings, mechanism), mechanism


@pytest.mark.filterwarnings("ignore::rsicalib.errors.OpenLoopsWarning")  # they do not close
def test_what_is_known_least_goes_with_the_parameter_that_is_named() -> None:
    """Witness: the place of the point by differences of `forward`, parameter by parameter."""
    found, mechanism = calibrated("ballbar")
    assert found.evidence is not None and found.evidence.weakest is not None
    weakest = found.evidence.weakest
    space = rsicalib.workspace(found, mechanism, poses=1500, seed=11)
    row = int(np.argmin(np.linalg.norm(space.poses - weakest.place, axis=1)))
    np.testing.assert_allclose(space.poses[row], weakest.place, rtol=1e-9)
    offsets = np.array([found[f"offset@{c.name}"].value for c in mechanism.channels])
    joints = _core.within_limits(mechanism, 1500, seed=11)[row]  # as drawn: offsets are zero
    readings = Readings.from_arrays(Bare(mechanism), joints[None] - offsets)
    along = np.array(weakest.along) / np.linalg.norm(weakest.along)

    def place(parameters: tuple[Parameter, ...]) -> float:
        there = dataclasses.replace(found, parameters=parameters)
        return float(rsicalib.forward(readings, mechanism, there)[0] @ along)

    slopes = []
    for k, p in enumerate(found.parameters):
        assert p.value is not None and p.sd is not None
        moved = dataclasses.replace(p, value=p.value + 0.1 * p.sd)
        shifted = place((*found.parameters[:k], moved, *found.parameters[k + 1 :]))
        slopes.append((shifted - place(found.parameters)) / (0.1 * p.sd))
    covariance = np.asarray(found.covariance)
    size = float(np.sqrt(slopes @ covariance @ slopes))
    assert size == pytest.approx(np.linalg.norm(weakest.along), rel=1e-3)
    correlations = covariance @ slopes / size / np.sqrt(np.diag(covariance))
    named = [(p.term, p.target) for p in found.parameters].index(
        (weakest.parameter.term, weakest.parameter.target)
    )
    assert np.argmax(np.abs(correlations)) == named
    assert abs(correlations[named]) == pytest.approx(weakest.correlation, rel=1e-3)
    assert f"offset of {weakest.parameter.target} (correlation" in found.report()


def test_parameters_stand_beside_those_of_an_earlier_result(tmp_path: Path) -> None:
    earlier = rsicalib.calibrate(READINGS)
    whole = rsicalib.load_readings(READINGS)
    values = whole.values.copy()
    values[:, 0] += 40.0
    found = rsicalib.calibrate(
        dataclasses.replace(whole, values=values), rest=REST, calibration=earlier
    )
    for p in found:
        old = earlier[p.key]
        assert p.earlier is not None and p.value is not None and p.sd is not None
        assert p.earlier.value == old.value
        assert p.earlier.sd == pytest.approx(np.hypot(p.sd, old.sd or 0.0))
        assert p.change == pytest.approx((p.value - p.earlier.value) / p.earlier.sd)
    assert [p.key for p in found if abs(p.change or 0.0) > 3.3] == ["offset@a11"]
    found.save(tmp_path / "result.json")
    read = rsicalib.load_calibration(tmp_path / "result.json")
    assert [p.change for p in read] == [p.change for p in found]
    page = read.report()
    change = f"{found['offset@a11'].change:+.1f}"
    for text in ('<th class="n">earlier</th>', "change [σ]", f'<td class="n">{change}</td>'):
        assert text in page
    assert "change [σ]" not in earlier.report() and earlier["gain@a11"].change is None


def test_channels_of_other_units_are_not_compared() -> None:
    sigma = {"q1": 2e-5, "q2": 1e-5, "x": 0.005}
    units = {"q1": "rad", "q2": "rad", "x": "mm"}
    noise = Noise("declared", sigma, None, None, units, "declared")
    figure = noise_figure(noise)
    bars = [e for e in ET.fromstring(figure.draw(svg.WIDE)).iter() if e.tag.endswith("rect")]
    q1, q2, x = (float(bar.get("width", "nan")) for bar in bars)
    assert q1 == x == pytest.approx(2 * q2, abs=0.1)
    assert "as declared" in figure.caption and "of its unit" in figure.caption
    assert "of its unit" not in noise_figure(dataclasses.replace(noise, unit={})).caption


def test_names_from_a_file_cannot_break_the_page(traced: Trace) -> None:
    bad = Excluded(3, None, "<b>", None, "a&b", '"<script>"')
    page = dataclasses.replace(
        traced,
        excluded=(bad,),
        warnings=(Warned("other", None, "<i>"),),
        mechanism="<u>",
        unobservable=("<s>",),
    ).report()
    Balance().feed(page)
    for tag in ("<b>", '"<script>"', "<i>", "<u>", "<s>"):
        assert tag not in page


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
        (1.0, "1.00"),
        (-0.01234, "-0.0123"),
        (125.4, "125"),
        (2982.0, "2982"),
        (1.6e-7, "1.60e-07"),
        (0.0009996, "1.00e-03"),
    ],
)
def test_numbers_have_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_a_value_has_as_many_digits_as_its_uncertainty_allows() -> None:
    assert plus_minus(3.38714, 0.00412) == ("3.3871", "0.0041")
    assert plus_minus(1234.5, 12.0) == ("1234", "12")
    assert plus_minus(3.38714, None) == ("3.38714", "–")
    assert plus_minus(None, 1.0) == ("–", "–")


def test_a_noisy_channel_is_named_beside_what_is_usual(traced: Trace) -> None:
    sigma = {"a11": 1.04, "a12": 1.04, "a13": 4.1}
    unit = dict.fromkeys(sigma, "count")
    noise = Noise("misclosure of repeats, by channel", sigma, 100.0, 0.0, unit)
    words = noise_words(dataclasses.replace(traced, noise=noise))
    assert words.startswith("1.04 count, but 4.10 in a13, per sample (misclosure of repeats, by")
    apart = Noise("declared", {"a11": 1.0, "a12": 2.0, "x": 0.5}, None, None, unit | {"x": "mm"})
    words = noise_words(dataclasses.replace(traced, noise=apart))
    assert words == "1.00 … 2.00 count and 0.500 mm per sample (declared)"


@pytest.mark.parametrize(
    ("kind", "words"), [("residual", "something is left at a22"), ("doubtful", "may stand")]
)
def test_what_is_partly_explained_leaves_structure_or_only_doubt(
    traced: Trace, kind: str, words: str
) -> None:
    left = Unexplained(p_value=None, target="a22", text="")
    verdict, reasons = "partly_explained", (Reason(kind),)
    result = dataclasses.replace(traced, verdict=verdict, unexplained=left, reasons=reasons)
    assert words in sentence(result)


def test_ticks_are_round_and_lie_within_the_bounds() -> None:
    rng = np.random.default_rng(1)
    for low, width in zip(rng.normal(size=200), np.exp(rng.uniform(-9, 9, 200)), strict=True):
        found = svg.ticks(low, low + width)
        assert 1 <= len(found) <= 7
        assert min(found) >= low - 1e-9 * width and max(found) <= low + width * (1 + 1e-9)


def test_json_has_null_for_what_is_not_known() -> None:
    values = {"a": float("nan"), "b": np.float64("inf"), "c": np.array([1.0, np.nan]), "d": (1,)}
    assert plain(values) == {"a": None, "b": None, "c": [1.0, None], "d": [1]}
    assert to_json(values) == '{"a": null, "b": null, "c": [1.0, null], "d": [1]}\n'


def test_the_curve_of_a_joint_that_slides_is_in_the_unit_of_length() -> None:
    """A slide of a gantry is bent by 0.6 mm in its middle, as no term but a free curve is."""
    device, scene, mechanism, _ = clean("gantry")
    slide = device.names.index("z1")
    low, high = scene.q[:, slide].min(), scene.q[:, slide].max()

    def bends(size: float, q: Array, scene: Scene) -> Array:
        out = np.zeros(q.shape)
        out[:, slide] = size * np.exp(
            -((8.0 * (q[:, slide] - 0.5 * (low + high)) / (high - low)) ** 2)
        )
        return out

    bump = Effect("bump", "sensor", "z1", 0.6, bends=bends, size=0.6)
    session = observe(device, scene, np.random.default_rng(3), (bump,))
    result = rsicalib.trace(readings_of(mechanism, session), mechanism)
    (step,) = result.steps
    assert (step.term, step.target, step.curve_unit) == ("free_curve", "z1", "mm")
    largest = max(abs(row[1]) for row in step.curve)
    assert 0.3 < largest < 0.9
    assert f"a curve of up to {number(largest, 2)} mm" in result.report()
    assert "mrad" not in "".join(
        line for line in result.report().split("<") if "correction" in line
    )


@pytest.mark.parametrize(
    ("unit", "words"), [("rad", "0.01 rad"), ("1", "0.01"), ("", "0.01"), (None, "0.01")]
)
def test_a_pure_number_stands_without_a_unit(unit: str | None, words: str) -> None:
    assert with_unit("0.01", unit) == words


def test_columns_of_the_summary_never_touch(traced: Trace) -> None:
    before = dataclasses.replace(traced.before, chi2=3.6e-9, dof=123456.7)
    (line,) = (
        line
        for line in dataclasses.replace(traced, before=before).summary().splitlines()
        if line.startswith("  χ² / degrees of freedom")
    )
    name, old, new = re.split(r" {2,}", line.strip())
    assert (name, old) == ("χ² / degrees of freedom", "3.60e-09 / 123457")
    assert new == f"{number(traced.after.chi2)} / {number(traced.after.dof)}"


def test_channels_of_other_units_say_theirs_in_the_summary() -> None:
    found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    lines = found.summary().splitlines()
    assert any(re.split(r" {2,}", line.strip())[1:] == HEADS for line in lines)
    slides = {"offset@a12": "mm", "gain@a12": "mm/count"}
    parameters = [
        dataclasses.replace(p, unit=slides.get(p.key, p.unit), target=p.target.replace("a2", LONG))
        for p in found.parameters
    ]
    lines = dataclasses.replace(found, parameters=tuple(parameters)).summary().splitlines()
    cells = {c[0]: c[1:] for line in lines if len(c := re.split(r" {2,}", line.strip())) == 3}
    assert cells["± 95 %"] == ["offset", "gain"]
    assert [cell.split()[-1] for cell in cells["a11"]] == ["rad", "mrad/count"]
    assert [cell.split()[-1] for cell in cells["a12"]] == ["mm", "mm/count"]
    assert f"{LONG}1" in cells


def test_the_page_of_garbage_says_why_and_draws_nothing() -> None:
    whole = rsicalib.load_readings(READINGS)
    values = np.random.default_rng(0).integers(0, 4096, whole.values.shape).astype(float)
    found = rsicalib.trace(dataclasses.replace(whole, values=values), rest=REST)
    assert found.verdict == "implausible"
    # What is to be said of all channels alike is said once.
    noise, open_loops = found.implausible
    assert found.noise is not None
    assert (noise.kind, noise.targets) == ("absurd_noise", tuple(found.noise.sigma))
    assert (open_loops.kind, open_loops.target) == ("absurd_misclosure", None)
    page = found.report()
    assert "<svg" not in page and "Error before and after" not in page
    assert "<h2>Why it cannot be used</h2>" in page
    assert page.count("these readings are not of this mechanism, or not in its units</li>") == 2
    assert found.figures() == {}


def test_nothing_is_called_certain_that_does_not_explain_it_all(traced: Trace) -> None:
    assert "It is certain that it is this sensor." in traced.report()
    part = dataclasses.replace(traced, verdict="partly_explained").report()
    assert "certain that" not in part and "does not explain it all" in part


def test_effects_of_several_sensors_are_said_of_all_of_them(traced: Trace) -> None:
    """What poses cannot tell apart is not called certain, however probable the rest makes it."""
    (step,) = traced.steps
    each = dataclasses.replace(step, term="offset", target="each", also_fits=())
    page = dataclasses.replace(traced, steps=(each,)).report()
    assert "All sensors read wrong, alike" in page
    assert "offset of each sensor" in page
    pair = dataclasses.replace(each, target="a11+a12")
    twin = Name(term="offset", target="a21+a22", klass="sensor")
    page = dataclasses.replace(traced, steps=(pair,)).report()
    assert "The sensors a11 and a12 read wrong, alike" in page
    tied = dataclasses.replace(traced, steps=(dataclasses.replace(pair, also_fits=(twin,)),))
    assert "cannot tell it from offset of sensors a21 and a22" in tied.report()
    assert "It is certain" not in tied.report()


def test_letters_are_as_wide_as_in_the_font_that_they_are_measured_in() -> None:
    """Witness: the font itself, which comes with matplotlib."""
    fonts = pytest.importorskip("fontTools.ttLib")
    folder = Path(pytest.importorskip("matplotlib").get_data_path()) / "fonts" / "ttf"
    for name, bold in (("DejaVuSans.ttf", False), ("DejaVuSans-Bold.ttf", True)):
        font = fonts.TTFont(folder / name)
        glyphs, wide = font.getBestCmap(), font["hmtx"]
        for letter in (*map(chr, range(32, 127)), *"±·²µσχ×°–—…"):
            true = wide[glyphs[ord(letter)]][0] / font["head"].unitsPerEm
            # Rounded up to steps of 0.05.
            assert true - 1e-9 <= width_of(letter, bold=bold) / SIZE < true + 0.05, letter


def test_a_name_that_is_certain_has_no_other_beside_it_in_the_headline() -> None:
    found = rsicalib.demo()
    step = dataclasses.replace(found.steps[0], also_fits=())
    own = Name(step.term, step.klass, step.target)
    other = Name("cubic", step.klass, step.target)

    def said(probability: float) -> str:
        shares = ((own, probability), (other, 1.0 - probability))
        rivals = tuple(
            dataclasses.replace(found.rivals[0], terms=(n,), probability=p) for n, p in shares
        )
        return plain_words(dataclasses.replace(found, steps=(step,), rivals=rivals), None)

    assert "may be" in said(0.6) and "may be" not in said(0.997)


def test_a_hidden_effect_of_two_channels_is_told_by_both() -> None:
    found = rsicalib.demo()
    at = [
        dataclasses.replace(found.could_hide[0], term="crosstalk", target="a11", place=place)
        for place in ("a12", "a13")
    ]
    lines = summary(dataclasses.replace(found, could_hide=tuple(at)), whole=True).splitlines()
    hiding = [line.split(" up to")[0] for line in lines if "may hide" in line]
    assert [line.split()[-1] for line in hiding] == ["a12", "a13"]


def test_what_is_left_of_rounding_is_nothing() -> None:
    assert plus_minus(1.38778e-16, None) == ("0", "–")
    assert plus_minus(1.4e-12, None)[0] != "0"


def test_an_implausible_result_of_labelled_places_has_its_labels_looked_at() -> None:
    found = dataclasses.replace(rsicalib.demo(), verdict="implausible")
    place = dataclasses.replace(found.parameters[0], term="unknown_point", target="cone[at=A]")
    labelled = dataclasses.replace(found, parameters=(place, *found.parameters[1:]))
    (more,) = set(advice(labelled)) - set(advice(found))
    assert "`at`" in more
