"""Reports in a real browser: no script error, every picture drawn, every switch, every number."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Trace
from rsicalib.facts.shapes import Excluded
from rsicalib.facts.warned import Warned
from rsicalib.report.page import mechanism_page
from rsicalib.report.poses import poses_html
from rsicalib.report.workspace import Shades
from rsicalib.reproduction.document import Cell, Misprint, Paper, Row, Table
from rsicalib.reproduction.page import html as paper_html
from tests import pages
from tests.browser import look, needs_chromium, sheets
from tests.test_families import clean

pytestmark = needs_chromium

WRONG = '<img src=x onerror="wrong.push(1)"></script><script>wrong.push(2)</script>'

PICTURES = """
const shown = [...document.querySelectorAll("figure svg")].filter((s) => s.getClientRects().length);
const size = (t) => t.getBoundingClientRect().height;
return {
  names: [...document.querySelectorAll("figure")].map((f) => f.id),
  shown: shown.map((s) => ({
    figure: s.closest("figure").id,
    shapes: s.querySelectorAll("circle, rect, polyline, polygon").length,
    wide: s.getBoundingClientRect().width,
    inside: s.getBBox().x >= -1 && s.getBBox().x + s.getBBox().width <= s.viewBox.baseVal.width + 1,
    broken: /NaN|undefined|Infinity/.test(s.outerHTML),
    smallest: Math.min(...[...s.querySelectorAll("text")].map(size).filter((h) => h > 0)),
  })),
  captions: [...document.querySelectorAll("figcaption")].filter((c) => !c.textContent).length,
  beyond: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  images: document.querySelectorAll("img").length,
};
"""

SWITCHES = """
const boxes = [...document.querySelectorAll("#switches input")];
const text = (query) => [...document.querySelectorAll(query)].map((c) => c.textContent);
const states = [];
for (let n = 0; n < 1 << boxes.length; n++) {
  boxes.forEach((box, i) => { if (box.checked !== Boolean(n >> i & 1)) box.click(); });
  states.push([".desk", ".phone"].map((which) => {
    const svg = document.querySelector("#switched " + which + " svg");
    const scale = svg.querySelector(".scale").dataset;
    return [...svg.querySelectorAll("[data-k]")].map((dot) =>
      [(dot.getAttribute("cy") - scale.zero) / scale.unit, +scale.bound, Math.abs(1 / scale.unit)]);
  }).concat([text("[data-error]"), text("[data-value]"), text("[data-half]"),
    text("#mechanism .desk [data-p] title").map((t) => +t.match(/([0-9.]+) σ$/)[1])]));
}
return states;
"""

TABLES = """
const rows = (words) => [...document.querySelectorAll(`[aria-label="${words}"] tbody tr`)]
  .map((row) => [...row.cells].map((cell) => cell.textContent));
return { parameters: rows("parameters"), errors: rows("error before and after"),
  hidden: rows("what could hide") };
"""


@pytest.fixture(scope="module")
def traced() -> Trace:
    """The demo with two readings that are wrong."""
    whole = rsicalib.load_readings(DEMO / "readings.csv")
    values = whole.values.copy()
    values[whole.pose == 17, 2] += 60.0
    values[whole.pose == 30, 7] -= 400.0
    readings = dataclasses.replace(whole, values=values)
    return rsicalib.trace(
        readings, rest=DEMO / "rest.csv", check=DEMO / "check.csv", device=WRONG, note=WRONG
    )


def shown_as(text: str, value: float | None) -> bool:
    """Whether a text is this number, to the last digit that it has."""
    if value is None:
        return text == "–"
    if text.startswith("<"):
        return value < float(text[1:])
    digits = text.lower().partition("e")
    places = len(digits[0].partition(".")[2])
    half = 0.5 * 10.0 ** (int(digits[2] or 0) - places)
    return abs(float(text) - value) <= half * (1 + 1e-6) + 1e-12 * abs(value)


@pytest.mark.parametrize("width", [1280, 500, 340])
def test_every_picture_is_drawn_at_every_width_without_a_script_error(
    traced: Trace, tmp_path: Path, width: int
) -> None:
    found, errors = look(traced.report(), PICTURES, tmp_path, width)
    assert errors == []
    names = {"residuals", "effect1-law", "effect1-added", "effect1-scores", "switched"}
    names |= {"mechanism", "workspace", "normal", "reliability"}
    assert set(found["names"]) == names
    assert sorted(s["figure"] for s in found["shown"]) == sorted(names)  # one of two widths each
    for picture in found["shown"]:
        assert picture["shapes"] >= 7 and picture["wide"] > 250, picture
        assert picture["inside"] and not picture["broken"], picture
        assert picture["smallest"] >= 10.0, picture  # height of a line: letters of 9 px
    assert found["captions"] == 0
    assert found["beyond"] <= 0
    assert found["images"] == 0  # the name of the device is text


FAMILIES = sorted({path.parent for path in Path("/usr/share/fonts").rglob("*.ttf")})


@pytest.mark.skipif(not FAMILIES, reason="no fonts in /usr/share/fonts")
@pytest.mark.parametrize("fonts", FAMILIES[:4], ids=lambda folder: folder.name)
def test_no_label_leaves_its_picture_in_any_font(
    traced: Trace, tmp_path: Path, fonts: Path
) -> None:
    """The page cannot know how wide the letters of a reader's browser are."""
    found, errors = look(traced.report(), PICTURES, tmp_path, 500, fonts)
    assert errors == []
    assert [s["figure"] for s in found["shown"] if not s["inside"]] == []
    assert found["beyond"] <= 0


@pytest.mark.parametrize(("family", "panels"), [("sockets", 2), ("gantry", 4)])
def test_the_workspace_of_any_mechanism_is_drawn_on_a_phone(
    family: str, panels: int, tmp_path: Path
) -> None:
    """Of an arm that touches unknown points, and of two chains that are joined."""
    _, _, mechanism, readings = clean(family)
    found, errors = look(rsicalib.calibrate(readings, mechanism).report(), PICTURES, tmp_path, 400)
    assert errors == []
    (picture,) = (s for s in found["shown"] if s["figure"] == "workspace")
    assert picture["shapes"] > 20 * panels
    for picture in found["shown"]:
        assert picture["inside"] and not picture["broken"], picture
        assert picture["smallest"] >= 11.0, picture
    assert found["beyond"] <= 0


def test_every_switch_shows_the_fit_without_its_suspect(traced: Trace, tmp_path: Path) -> None:
    states, errors = look(traced.report(), SWITCHES, tmp_path)
    assert errors == []
    assert traced.evidence is not None and traced.evidence.switchboard is not None
    board = traced.evidence.switchboard
    assert [s.pose for s in board.switches if s.pose is not None] == [
        e.pose for e in traced.excluded
    ]
    assert len(states) == len(board.fits) == 8
    assert traced.evidence.drawing is not None
    poses = list(traced.evidence.drawing.poses)
    for (wide, narrow, error, values, halves, heats), fit in zip(states, board.fits, strict=True):
        rows = np.array(fit.residuals).reshape(48, 3)
        sizes = np.sqrt((rows**2).mean(axis=1))[poses]
        np.testing.assert_allclose(heats, sizes, atol=0.06)
        for dots in (wide, narrow):
            for (value, bound, pixel), true in zip(dots, fit.residuals, strict=True):
                # Pixels are written to a tenth, residuals in the page to a hundredth.
                expected = float(np.clip(true, -bound, bound))
                assert value == pytest.approx(expected, abs=0.05 * pixel + 0.006)
        chi2, dof = error[0].split(" / ")
        assert shown_as(chi2, fit.chi2) and shown_as(dof, fit.dof)
        assert shown_as(error[1].replace("< ", "<"), fit.p_value)
        assert shown_as(error[2], fit.rms_misclosure)
        assert all(map(shown_as, values, fit.values))
        assert all(
            shown_as(half, None if sd is None else 1.96 * sd)
            for half, sd in zip(halves, fit.sd, strict=False)  # then those of hypotheses alone
        )


CHOICES = """
const text = (query) => [...document.querySelectorAll(query)].map((c) => c.textContent);
return [...document.querySelectorAll("#hypotheses input")].map((choice) => {
  choice.click();
  const svg = document.querySelector("#switched .desk svg");
  const scale = svg.querySelector(".scale").dataset;
  return { error: text("[data-error]"),
    dots: [...svg.querySelectorAll("[data-k]")].map((dot) =>
      (dot.getAttribute("cy") - scale.zero) / scale.unit),
    pixel: Math.abs(1 / scale.unit), bound: +scale.bound,
    chosen: document.querySelector('#mechanism .desk [data-is="chosen"]').getAttribute("d") };
});
"""


def test_every_hypothesis_shows_its_residual_its_error_and_where_it_puts_the_platform(
    traced: Trace, tmp_path: Path
) -> None:
    states, errors = look(traced.report(), CHOICES, tmp_path)
    assert errors == []
    assert traced.evidence is not None
    known = traced.evidence.hypotheses
    assert [one.kind for one in known][:2] == ["nothing", "found"]
    assert len(states) == len(known)
    for state, one in zip(states, known, strict=True):
        # What a law that no term has does at known poses is not known.
        assert (one.check is None) == (one.kind == "unknown_law")
        assert shown_as(state["error"][0].split(" / ")[0], one.fit.chi2)
        assert shown_as(state["error"][3], one.check and one.check.position_rms)
        expected = np.clip(one.fit.residuals, -state["bound"], state["bound"])
        # Pixels are written to a tenth, residuals in the page to a hundredth.
        np.testing.assert_allclose(
            state["dots"], expected, atol=0.05 * state["pixel"] + 0.006, rtol=0.0
        )


KEPT = """
const now = () => document.querySelector("[data-now]").textContent, choices =
  [...document.querySelectorAll("#hypotheses input")], first = now();
choices[0].click();
choices[1].click();
return [first, now()];
"""


def test_what_was_found_and_is_not_applied_is_shown_where_it_is_chosen(tmp_path: Path) -> None:
    found = pages.SESSIONS["partly"]()
    assert not any(step.applied for step in found.steps)
    (first, chosen), errors = look(found.report(), KEPT, tmp_path)
    assert errors == []
    assert found.evidence is not None and found.after.check is not None
    with_it = found.evidence.hypotheses[1]
    assert with_it.kind == "found" and with_it.check is not None
    assert shown_as(first, found.after.check.position_rms)
    assert shown_as(chosen, with_it.check.position_rms)
    assert with_it.check.position_rms < 0.5 * found.after.check.position_rms


FOLLOWS = """
window.requestAnimationFrame = (act) => act();
const cells = () => [...document.querySelectorAll("#workspace .desk [data-w]")]
  .map((cell) => cell.getAttribute("class"));
return [...document.querySelectorAll("#hypotheses input")].map((choice) => {
  choice.click();
  const laws = [...document.querySelectorAll("#effect1-law .desk [data-law]")];
  const level = [...document.querySelectorAll("#mechanism .desk .cells path")]
    .flatMap((p) => p.getAttribute("d").split("M").slice(1).map(() => p.getAttribute("class")));
  return { cells: cells(), level: level.sort(),
    picked: laws.filter((l) => l.classList.contains("picked")).map((l) => l.dataset.law),
    faint: laws.filter((l) => l.classList.contains("unchosen")).map((l) => l.dataset.law) };
});
"""


def test_the_law_and_the_workspace_follow_the_hypothesis(traced: Trace, tmp_path: Path) -> None:
    states, errors = look(traced.report(), FOLLOWS, tmp_path)
    assert errors == []
    assert traced.evidence is not None
    known, drawn = traced.evidence.hypotheses, traced.evidence.workspace
    shades = Shades(drawn)
    (step,) = traced.steps
    laws = {f"{n.term}@{n.target}" for n in (step, *step.also_fits)} | {"free_curve@a22"}
    for state, one in zip(states, known, strict=True):
        there = [{cell[:2]: cell[2] for cell in part.cells} for part in one.workspace]
        sd = [
            part.get(cell[:2])
            for part, base in zip(there, drawn, strict=True)
            for cell in base.cells
        ]
        # Two digits of a number stand in the page: one that is an edge may have either shade.
        expected = [{"usual"} if v is None else shown_shades(shades, v) for v in sd]
        assert all(c in e for c, e in zip(state["cells"], expected, strict=True)), one.kind
        level = sorted(state["cells"][: len(drawn[0].cells)])
        assert state["level"] == [c for c in level if c != "usual"]
        effects = {f"{n.term}@{n.target}" for n in one.effects}
        if one.kind == "found":
            assert state["picked"] == state["faint"] == []
        else:
            assert set(state["picked"]) == effects & laws
            assert set(state["faint"]) == laws - effects


def shown_shades(shades: Shades, sd: float) -> set[str]:
    """Shades that a number may have, written in two digits or as it is."""
    return {f"sd{shades.of(v)}" for v in (sd, float(f"{sd:.2g}"))}


FADES = """
const fader = document.getElementById("fader");
const chosen = document.querySelector('#mechanism .desk [data-is="chosen"]');
const arrows = () => chosen.getAttribute("d");
const now = () => document.querySelector("[data-now]").textContent;
window.requestAnimationFrame = (act) => act();
return [100, 50, 0].map((share) => {
  fader.value = share;
  fader.dispatchEvent(new Event("input"));
  return [now(), arrows().length, document.querySelector("[data-error='0']").textContent];
});
"""


def test_the_fader_moves_the_error_at_check_poses_and_the_arrows(
    traced: Trace, tmp_path: Path
) -> None:
    ((full, none_drawn, _), (half, drawn, _), (nothing, most, _)), errors = look(
        traced.report(), FADES, tmp_path
    )
    assert errors == []
    assert traced.evidence is not None
    assert none_drawn == 0 < drawn <= most
    assert traced.after.check is not None
    assert shown_as(full, traced.after.check.position_rms)
    before = traced.evidence.hypotheses[0]
    assert before.check is not None and before.check.position_rms is not None
    # Arrows in the page, from which it is told, have four digits.
    assert float(nothing) == pytest.approx(before.check.position_rms, rel=5e-3)
    # Witness of the middle: the known poses as both hypotheses place them.
    assert traced.evidence.drawing is not None
    known = traced.evidence.drawing.known
    at, old, new = (np.array([getattr(k, n) for k in known]) for n in ("at", "before", "after"))
    assert float(half) == pytest.approx(np.sqrt(np.mean(((old + new) / 2 - at) ** 2)), rel=5e-3)


HALVES = """
return [...document.querySelectorAll(".pictures")].filter((p) => p.getClientRects().length)
  .map((p) => {
    const box = p.getBoundingClientRect(), last = p.lastElementChild.getBoundingClientRect();
    return (last.right - box.left) / box.width;
  });
"""


def test_no_row_of_pictures_has_an_empty_half(traced: Trace, tmp_path: Path) -> None:
    found, errors = look(traced.report(), HALVES, tmp_path, 1280)
    assert errors == []
    assert len(found) >= 4 and min(found) > 0.95


TURNS = """
const view = document.querySelector("#mechanism .desk");
const frame = (act) => { const all = []; window.requestAnimationFrame = (f) => all.push(f);
  act(); all.forEach((f) => f()); };
const at = () => [...view.querySelectorAll("circle[data-p]")].map((dot) =>
  [+dot.getAttribute("cx"), +dot.getAttribute("cy")]);
const { x, y } = view.querySelector(".scene").dataset;
const first = at();
frame(() => view.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" })));
const turned = at();
frame(() => document.querySelectorAll("#mechanism .views button")[1].click());
const above = at();
frame(() => view.dispatchEvent(new KeyboardEvent("keydown", { key: "Home" })));
const data = JSON.parse(document.getElementById("mechanism-data").textContent);
const bar = view.querySelector("[data-bar]");
return { first, turned, above, back: at(), x: +x, y: +y, centre: data.centre,
  radius: data.radius, tall: data.tall, margin: data.margin,
  bar: [+bar.dataset.bar, +bar.getAttribute("d").match(/h([0-9.]+)/)[1]] };
"""


def test_keys_and_buttons_turn_the_mechanism(traced: Trace, tmp_path: Path) -> None:
    """Against matrices of rotations: about z by the azimuth, then up by the elevation."""
    found, errors = look(traced.report(), TURNS, tmp_path)
    assert errors == []
    assert traced.evidence is not None and traced.evidence.drawing is not None
    places = np.array(traced.evidence.drawing.places) - found["centre"]

    def scale(elevation: float) -> float:
        """All of it stands in a cylinder: its width, and its height where it is tilted."""
        up = found["tall"] * np.cos(elevation) + found["radius"] * np.sin(elevation)
        room = found["x"] - found["margin"], found["y"] - found["margin"]
        return float(min(room[0] / found["radius"], room[1] / up))

    def seen(azimuth: float, elevation: float) -> np.ndarray:
        c, s = np.cos(azimuth), np.sin(azimuth)
        about_z = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # x to the viewer
        c, s = np.cos(elevation), np.sin(elevation)
        up = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        at = scale(elevation) * places @ (up @ about_z).T
        return np.stack([found["x"] + at[:, 1], found["y"] - at[:, 2]], axis=1)

    for name, view in {
        "first": (35.0, 20.0),
        "turned": (30.0, 20.0),
        "above": (-90.0, 90.0),
        "back": (35.0, 20.0),
    }.items():
        # Pixels are written to a tenth.
        np.testing.assert_allclose(found[name], seen(*np.radians(view)), atol=0.07, rtol=0.0)
    length, pixels = found["bar"]
    assert pixels == pytest.approx(length * scale(np.radians(20.0)), abs=0.06)


def test_the_arrows_at_check_poses_are_the_errors_that_the_result_says(traced: Trace) -> None:
    evidence = traced.evidence
    assert evidence is not None and evidence.drawing is not None
    known = evidence.drawing.known
    at, before, after = (
        np.array([getattr(k, n) for k in known]) for n in ("at", "before", "after")
    )
    found = rsicalib.forward(DEMO / "check.csv", calibration=traced)
    table = rsicalib.load_readings(DEMO / "check.csv")
    assert table.poses is not None
    labels = np.asarray(table.pose)
    means = np.array([found[labels == k].mean(axis=0)[:3] for k in dict.fromkeys(labels)])
    # The pose of a mean reading and the mean of the poses differ to second order in the noise;
    # the fit to means of samples differs from that to samples as little.
    np.testing.assert_allclose(after, means, atol=2e-4)
    assert traced.after.check is not None
    rms = np.sqrt(np.mean((after - at) ** 2))
    assert rms == pytest.approx(traced.after.check.position_rms, rel=0.02)
    nothing = evidence.hypotheses[0]
    assert nothing.check is not None
    assert np.sqrt(np.mean((before - at) ** 2)) == pytest.approx(nothing.check.position_rms)


MOVES = """
const all = [];
window.requestAnimationFrame = (act) => all.push(act);
const button = document.querySelector(".moves");
const at = () => document.querySelector("#mechanism .desk circle[data-p]").getAttribute("cx");
const words = [button.textContent];
button.click();
words.push(button.textContent);
const held = at();
button.click();
const step = (now) => all.splice(0).forEach((act) => act(now));
[0, 100, 200].forEach(step);
const moved = at();
document.querySelector("#mechanism .desk").dispatchEvent(
  new KeyboardEvent("keydown", { key: "ArrowUp", bubbles: true }));
words.push(button.textContent);
const stopped = at();
[300, 400].forEach(step);
return { words, held, moved, stopped, last: at() };
"""


def test_the_mechanism_by_itself_turns_until_it_is_held(traced: Trace, tmp_path: Path) -> None:
    assert traced.evidence is not None
    found, errors = look(mechanism_page(traced, traced.evidence), MOVES, tmp_path)
    assert errors == []
    assert found["words"] == ["hold still", "turn", "turn"]
    assert found["held"] != found["moved"]
    # A key that tilts leaves the azimuth, and nothing turns on.
    assert found["stopped"] == found["moved"]
    assert float(found["last"]) == pytest.approx(float(found["stopped"]), abs=40.0)


SAVES = """
const given = [];
URL.createObjectURL = (blob) => { given.push(blob.type); return "blob:none"; };
HTMLAnchorElement.prototype.click = () => {};
document.querySelectorAll(".save button").forEach((button) => {
  if (button.textContent === "SVG") button.click();
});
const dot = document.querySelector("#residuals .desk [data-p='3']");
dot.dispatchEvent(new PointerEvent("pointerover", { bubbles: true }));
const scene = JSON.parse(document.getElementById("mechanism-data").textContent);
return { given, figures: document.querySelectorAll("figure").length,
  body: scene.ghosts[scene.poses.indexOf(3)].flat(),
  lit: [...document.querySelectorAll(".lit")].map((d) => [d.closest("figure").id, d.dataset.p]),
  words: document.getElementById("pose-words").textContent };
"""


def test_every_figure_can_be_saved_and_a_pose_lights_up_in_all(
    traced: Trace, tmp_path: Path
) -> None:
    found, errors = look(traced.report(), SAVES, tmp_path)
    assert errors == []
    assert found["given"] == ["image/svg+xml"] * found["figures"]
    everywhere = {"mechanism", "residuals", "switched", "normal", "reliability"}
    everywhere |= {"effect1-law", "effect1-added"}
    assert {figure for figure, _ in found["lit"]} == everywhere
    # The mechanism itself goes to the pose: its first joint that moves.
    assert traced.evidence is not None and traced.evidence.drawing is not None
    row = traced.evidence.drawing.poses.index(3)
    np.testing.assert_allclose(found["body"], traced.evidence.drawing.at[row], atol=1e-3)
    assert {p for _, p in found["lit"]} == {"3"}
    assert traced.evidence is not None
    label = traced.evidence.poses[3]
    first = traced.evidence.readings[3][0]
    assert found["words"].startswith(f"pose {label}: a11 {first:.5g}"[:16])


def test_the_fit_with_all_switches_on_is_the_result_and_all_off_what_it_began_with(
    traced: Trace,
) -> None:
    assert traced.evidence is not None and traced.evidence.switchboard is not None
    fits = traced.evidence.switchboard.fits
    # Means of samples instead of samples: to second order in the noise the same.
    assert fits[-1].chi2 == pytest.approx(traced.after.chi2, rel=0.01)
    assert fits[0].chi2 == pytest.approx(traced.before.chi2, rel=0.01)
    assert (fits[-1].dof, fits[0].dof) == pytest.approx((traced.after.dof, traced.before.dof))


def test_each_number_of_the_tables_is_that_of_the_json(traced: Trace, tmp_path: Path) -> None:
    found, _ = look(traced.report(), TABLES, tmp_path)
    result: dict[str, Any] = json.loads(traced.to_json())
    assert len(found["parameters"]) == len(result["parameters"])
    for row, p in zip(found["parameters"], result["parameters"], strict=True):
        assert row[0].split(" at ")[0] == p["target"] and row[4] == p["unit"]
        assert shown_as(row[2], p["value"])
        assert shown_as(row[3], None if p["sd"] is None else 1.96 * p["sd"])
    before, after = result["before"], result["after"]
    errors = {row[0]: row[1:] for row in found["errors"]}
    keys = {"misclosure, rms [in]": "rms_misclosure", "p-value": "p_value"}
    for words, key in keys.items():
        shown = [text.replace("< ", "<") for text in errors[words]]
        assert shown_as(shown[0], before[key]) and shown_as(shown[1], after[key])
    for shown, fit in zip(errors["χ² / degrees of freedom"], (before, after), strict=True):
        chi2, dof = shown.split(" / ")
        assert shown_as(chi2, fit["chi2"]) and shown_as(dof, fit["dof"])
    for row, hidden in zip(found["hidden"], result["could_hide"], strict=False):
        size, unit = row[2].split(" ", 1)
        assert unit == hidden["unit"] and shown_as(size, hidden["detectable"])
        if hidden["platform_rms"] is not None:
            assert shown_as(row[3], hidden["platform_rms"]["position"])
            assert shown_as(row[4], hidden["platform_rms"]["orientation"])


def test_text_of_any_kind_stays_text(traced: Trace, tmp_path: Path) -> None:
    bad = Excluded(3, None, WRONG, None, WRONG, WRONG)
    assert traced.evidence is not None and traced.evidence.switchboard is not None
    board = traced.evidence.switchboard
    switch = dataclasses.replace(board.switches[1], channel=WRONG)
    board = dataclasses.replace(board, switches=(board.switches[0], switch, *board.switches[2:]))
    evidence = dataclasses.replace(
        traced.evidence, switchboard=board, equations=(WRONG,) * len(traced.evidence.equations)
    )
    step = dataclasses.replace(traced.steps[0], target=WRONG)
    result = dataclasses.replace(
        traced,
        excluded=(bad,),
        warnings=(Warned("other", WRONG, WRONG),),
        mechanism=WRONG,
        steps=(step,),
    )
    result.__dict__["evidence"] = evidence
    found, errors = look(result.report(), PICTURES, tmp_path)
    assert errors == [] and found["images"] == 0


def test_the_page_of_a_plan_has_a_row_and_a_dot_for_each_pose(tmp_path: Path) -> None:
    found = rsicalib.plan(poses=12, candidates=300, starts=1)
    said = found.mechanism, found.length_unit, found.csv(), found.brings(), found.poses
    probe = """
    const heads = [...document.querySelectorAll("thead th")].map((cell) => cell.textContent);
    const column = (head) => [...document.querySelectorAll("tbody tr")]
      .map((row) => row.cells[heads.indexOf(head)].textContent);
    const why = document.body.textContent.match(/Why: each is (.*)\\./)[1];
    return [column("pose"), why, column("x").map(Number), column("a22").map(Number),
      [...document.querySelectorAll(".desk circle title")].map((t) => t.textContent)];
    """
    (labels, why, x, a22, dots), errors = look(poses_html(*said), probe, tmp_path)
    assert errors == []
    assert labels == [str(k) for k in range(1, 13)]
    assert {why} == set(found.why)
    np.testing.assert_allclose(x, found.poses[:, 0], atol=5e-5)
    np.testing.assert_allclose(a22, found.readings[:, found.channels.index("a22")], rtol=5e-6)
    assert [text.split(":")[0] for text in dots] == 2 * [f"pose {label}" for label in labels]


def test_the_page_of_a_plan_says_what_it_brings_and_no_pose_twice(tmp_path: Path) -> None:
    found = rsicalib.plan(poses=12, candidates=300, starts=1)
    found = dataclasses.replace(found, advice=("More poses are better.",), merged=("A is B",))
    assert found.text().splitlines()[:2] == ["More poses are better.", ""]
    probe = """
    const [brings] = [...document.querySelectorAll("section")]
      .filter((one) => one.querySelector("h2").textContent === "What they bring");
    return [[...brings.querySelectorAll("p")].map((one) => one.textContent),
      [...brings.querySelectorAll("li")].map((one) => one.textContent)];
    """
    said = found.mechanism, found.length_unit, found.csv(), found.brings(), found.poses
    (heads, lines), errors = look(poses_html(*said), probe, tmp_path)
    assert errors == []
    assert lines == [line for _, below in found.brings() for line in below]
    assert [head for head in heads if head] == [f"{found.brings()[1][0].capitalize()}:"]


def test_the_page_of_the_paper_has_every_table_and_every_misprint(tmp_path: Path) -> None:
    rows = (Row("1", (Cell(2.0, 1.0), Cell(0.5, 0.5, 0.1))), Row(WRONG, (Cell(1.0, 50.0),)))
    tables = (Table("I", "lengths", ("a", "b"), rows, "reproduced", (WRONG,)),)
    misprint = Misprint("eq. (4)", "-", "+", WRONG, {})
    page = paper_html(Paper("rsicalib.paper/1", "0", 2, 0, tables, (misprint,)))
    probe = """
    const zero = +document.querySelector(".desk .zero").getAttribute("y1");
    return [[...document.querySelectorAll("tbody td")].map((cell) => cell.textContent),
      [...document.querySelectorAll(".desk circle")].map((c) => zero - c.getAttribute("cy"))];
    """
    (cells, heights), errors = look(page, probe, tmp_path)
    assert errors == []
    assert cells == [
        *("1", "2 (1)", "0.5 ±\u00a00.1 (0.5)"),
        *(WRONG, "1 (50)", ""),
        *("eq. (4)", "-", "+", WRONG),
    ]
    twice, same, beyond = heights
    assert same == pytest.approx(0.0, abs=0.1) and twice > 0.0
    assert beyond == pytest.approx(-twice / np.log10(2.0), abs=0.5)  # at the edge, a tenth


POINTED = """
return [...document.querySelectorAll("#mechanism .desk circle[data-p]")].map((dot) => {
  dot.scrollIntoView({ block: "center" });
  const box = dot.getBoundingClientRect();
  const there = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
  there.dispatchEvent(new PointerEvent("pointerover", { bubbles: true }));
  const words = document.getElementById("pose-words").textContent;
  return [there === dot, document.querySelectorAll(`figure .lit`).length, words];
});
"""


def test_poses_of_the_mechanism_answer_to_a_pointer(traced: Trace, tmp_path: Path) -> None:
    """A few lie under another dot or a check pose."""
    found, errors = look(traced.report(), POINTED, tmp_path)
    assert errors == []
    reached = [(count, words) for own, count, words in found if own]
    assert len(reached) > 0.7 * len(found)
    assert all(count > 5 and words.startswith("pose ") for count, words in reached)


def test_a_report_is_printed_on_few_sheets(tmp_path: Path) -> None:
    """Tables of many rows are in two columns, and pictures side by side."""
    page = rsicalib.demo().report().replace("</style>", "@page { size: A4; }</style>", 1)
    file = tmp_path / "page.html"
    file.write_text(page, encoding="utf-8")
    assert sheets(file) == 3
