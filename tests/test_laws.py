"""Terms that users write, what chains share, and what an effect would do."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, ncx2

import rsicalib
from rsicalib import DEMO, InputError, Mechanism, Term
from rsicalib.cli import main
from rsicalib.planning.supposing import suppose
from scripts import make_gallery
from tests.families.device import Effect, Scene, observe
from tests.families.draw import FAMILIES
from tests.families.power import Linear
from tests.families.trials import readings_of
from tests.full import sized
from tests.laws import curves, shared, trials
from tests.laws.draw import LAWS
from tests.oracle import Array

READINGS, REST = DEMO / "readings.csv", DEMO / "rest.csv"

LOBES = """
[[term]]
id = "three_per_turn"
class = "sensor"
per = "channel"
correction = "a*sin(3*phi) + b*cos(3*phi)"
parameters = {a = 0.01, b = 0.01}
doc = "A gear of three lobes."
"""


def law(correction: str, **more: object) -> Term:
    keys: dict[str, object] = {"klass": "sensor", "per": "channel", "parameters": {"a": 0.01}}
    return Term("own", correction=correction, **(keys | more))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def lobes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("laws") / "own.toml"
    path.write_text(Mechanism.rsi().to_toml() + LOBES, encoding="utf-8")
    return path


def test_a_term_of_a_mechanism_file_is_listed_with_its_formula(lobes: Path) -> None:
    own = rsicalib.terms(lobes)[-1]
    assert own["id"] == "three_per_turn"
    assert "correction = a*sin(3*phi) + b*cos(3*phi)" in own["doc"]
    assert [p["unit"] for p in own["parameters"]] == ["rad", "rad"]
    assert own["targets"] == [c.name for c in Mechanism.rsi().channels] + [
        "each.1",
        "each.2",
        "each.3",
    ]


def test_a_term_is_the_same_in_the_file_and_in_python(lobes: Path) -> None:
    (read,) = rsicalib.load_mechanism(lobes).terms
    made = Term(
        "three_per_turn",
        klass="sensor",
        per="channel",
        correction="a*sin(3*phi) + b*cos(3*phi)",
        parameters={"a": 0.01, "b": 0.01},
        doc="A gear of three lobes.",
    )
    assert read == made == copy.copy(made) == pickle.loads(pickle.dumps(made))
    assert Term.from_dict(made.to_dict()) == made
    whole = Mechanism.rsi().with_terms([made])
    assert whole.terms == [made]
    assert Mechanism.from_toml(whole.to_toml()).terms == [made]


@pytest.mark.parametrize(
    ("correction", "words"),
    [
        ("a*sin(3*ph)", 'character 9: "ph"'),
        ("a*sin(3*phi", "character 12: the end of the formula"),
        ("a*u + * u", "character 7: '*'"),
        ("a*cot(u)", 'character 3: function "cot"'),
        ("a*u + 1", "expected 0: no effect"),
        ("a*b*u", 'character 3: "b"'),
        ("a*a*u", 'parameter "a", which changes nothing by itself'),
        ("a*theta[9]", "expected theta[1] to theta[3]"),
        ("a*ln(-1)", "no effect"),
    ],
)
def test_a_wrong_formula_is_refused_with_the_place_in_it(correction: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        Mechanism.rsi().with_terms([law(correction)])
    assert words in str(refused.value)


@pytest.mark.parametrize(
    "correction",
    [
        "a*step(t - 0.918)",
        "a*step(0.02 - t)",
        "a*step(t - 0.9) - a*step(t - 0.9005)",
        "a*exp(-((t - 0.918)/0.001)^2)",
        "a/(1 + exp(-5000*(t - 0.918)))",
        "a*step(reading - 3000)",
        "a*step(u - 0.95)",
        "a*min(0, u + 0.9)",
        "a*max(0, abs(theta[2]) - 3)",
        "a*sqrt(max(0, temperature - 12))",
        "a*(theta[1] - theta[3])*step(theta[2] + 2.1)",
        "(1 + a)*step(t - 0.9) - step(t - 0.9)",
    ],
)
def test_a_law_that_acts_at_a_few_places_only_is_a_law(correction: str) -> None:
    assert Mechanism.rsi().with_terms([law(correction)]).terms[0].id


@pytest.mark.parametrize("index", ["a21", "a21, 0", "a21, -0.1", "a21, wide", "a99, 0.1"])
def test_a_play_has_a_channel_and_a_width(index: str) -> None:
    with pytest.raises(InputError, match=r"play\[CHANNEL, WIDTH\]"):
        Mechanism.rsi().with_terms([law(f"a*play[{index}]")])


def path(q: Array) -> Array:
    """How far a joint has gone, pose by pose."""
    return np.cumsum(np.abs(np.diff(q, prepend=q[0])))


def since_turn(q: Array) -> Array:
    """How far a joint is from where it turned last, or began."""
    steps = np.sign(np.diff(q))
    turns = [0, *(k for k in range(1, len(steps)) if steps[k] != steps[k - 1])]
    return np.array([q[k] - q[max(t for t in turns if t < max(k, 1))] for k in range(len(q))])


def in_play(q: Array, width: float) -> Array:
    """Where a joint is between the sides of a play that it drags along: -1 to 1."""
    sides, middle = [], float(q[0])
    for place in q:
        middle = min(max(middle, float(place) - width), float(place) + width)
        sides.append((float(place) - middle) / width)
    return np.array(sides)


@pytest.mark.parametrize(
    ("correction", "way"),
    [
        ("a*(1 - exp(-travelled[a21]/4))", lambda q: -np.expm1(-path(q) / 4)),
        ("a*since_turn[a21]", since_turn),
        ("a*play[a21, 0.2]", lambda q: in_play(q, 0.2)),
    ],
)
def test_a_law_may_be_of_the_way_of_another_channel(
    correction: str, way: Callable[[Array], Array]
) -> None:
    rng = np.random.default_rng(20261126)
    device = trials.built(rng)
    scene = trials.taken(device, rng, 48, 8)
    own, other = (device.names.index(name) for name in ("a12", "a21"))

    def bends(size: float, q: Array, scene: Scene) -> Array:
        first = np.flatnonzero(np.diff(scene.label, prepend=0))
        out = np.zeros(q.shape)
        out[:, own] = size * way(q[first, other])[scene.label - 1]
        return out

    effect = Effect("own", "sensor", "a12", 0.01, bends=bends, size=0.03)
    session = observe(device, scene, rng, (effect,))
    mechanism = Mechanism.from_toml(trials.toml(device)).with_terms([law(correction)])
    readings = readings_of(mechanism, session)
    found = rsicalib.calibrate(readings, mechanism, terms=["offset", "gain", "own@a12"])
    (a,) = (p for p in found.parameters if p.term == "own")
    # The way is by the gains of the drawing, to a hundredth.
    assert abs(a.value - effect.size) < 4 * a.sd + 0.01 * effect.size
    assert a.sd < effect.size / 10
    assert found.verdict == "adequate"


@pytest.mark.parametrize("correction", ["a*u + step(t - 0.918)", "a*u + exp(-((t - 0.9)/1e-4)^2)"])
def test_an_effect_without_its_parameters_is_refused_however_seldom(correction: str) -> None:
    with pytest.raises(InputError, match="no effect"):
        Mechanism.rsi().with_terms([law(correction)])


def test_a_law_may_have_64_parameters_and_all_are_fitted() -> None:
    """A bump at each of 64 places of a sensor's range, 63 of them zero in the device."""
    places = [f"p{k:02d}" for k in range(64)]
    text = " + ".join(f"{p}*max(0, 1 - abs(32*u - {k - 32}))" for k, p in enumerate(places))
    many = Term("many", klass="sensor", per="channel", correction=text,
                parameters=dict.fromkeys(places, 1e-3))  # fmt: skip
    values = Mechanism.rsi().with_terms([many]).to_dict()
    values["model"]["sd"] = {"many": 1e-3}
    mechanism = Mechanism(values)
    found = rsicalib.calibrate(READINGS, mechanism, terms=["offset", "gain", "many@a22"])
    own = [p for p in found.parameters if p.term == "many"]
    assert [p.name for p in own] == places
    sd = np.array([p.sd for p in own])
    # Places that no reading visits are as far known as they were declared, the others better.
    assert np.all(sd < 1.001e-3) and 5 < np.sum(sd < 0.9e-3) < 60


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"klass": "data"}, "class"),
        ({"per": "row"}, "per"),
        ({"klass": "geometry", "per": "row"}, "`moves` and `amount`"),
        ({"parameters": {}}, "1 to 64"),
        ({"parameters": {f"p{k}": 1.0 for k in range(65)}}, "1 to 64"),
        ({"parameters": {"a": -1.0}}, "a typical size above 0"),
        ({"parameters": {"u": 1.0}}, "a name that is no variable"),
        ({"klass": "closure", "per": "closure"}, 'character 3: "u"'),
    ],
)
def test_entries_that_contradict_each_other_are_refused(
    more: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError) as refused:
        law("a*u", **more)
    assert words in str(refused.value)


def test_the_name_of_a_term_of_the_catalogue_is_taken() -> None:
    taken = Term("gain", klass="sensor", per="channel", correction="a*u", parameters={"a": 1.0})
    with pytest.raises(InputError, match="a term of the catalogue"):
        Mechanism.rsi().with_terms([taken])


@pytest.mark.parametrize("name", sized([min(LAWS), max(LAWS)], LAWS))
def test_a_law_in_one_line_is_found_in_a_device_that_has_it(name: str) -> None:
    said = trials.answer(trials.make(name, 0, seed=5), [LAWS[name].entry])
    assert said.named, said


def test_a_result_with_a_law_applies_to_a_mechanism_without_it(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    gear = law("a*sin(3*phi)")
    mechanism = Mechanism.rsi().with_terms([gear])
    terms = ["offset", "gain", "own@a22"]
    found = rsicalib.calibrate(READINGS, mechanism, rest=REST, terms=terms)
    found.save(path)
    assert found["own", "a22"].unit == "rad"
    assert json.loads(path.read_text(encoding="utf-8"))["laws"] == [gear.to_dict()]
    with_law = rsicalib.forward(DEMO / "check.csv", mechanism, calibration=found)
    without = rsicalib.forward(DEMO / "check.csv", "rsi", calibration=path)
    np.testing.assert_array_equal(with_law, without)
    other = Mechanism.rsi().with_terms([law("a*sin(2*phi)")])
    with pytest.raises(InputError, match="own"):
        rsicalib.forward(DEMO / "check.csv", other, calibration=path)


def test_a_law_is_told_to_be_left_out_of_an_exported_mechanism(tmp_path: Path) -> None:
    mechanism = Mechanism.rsi().with_terms([law("a*sin(3*phi)")])
    terms = ["offset", "gain", "own@a22"]
    found = rsicalib.calibrate(READINGS, mechanism, rest=REST, terms=terms)
    assert "own@a22" in rsicalib.export_toml(mechanism, found)


@pytest.mark.parametrize("family", ["rsi", "rps"])
def test_a_mistake_that_all_chains_share_is_one_constant(family: str) -> None:
    said = [shared.run((family, True, k), seed=3) for k in range(sized(1, 2))]
    assert all(s.one for s in said), said


def test_chains_that_differ_share_nothing() -> None:
    said = shared.run(("rsi", False, 1), seed=3)
    assert not said.shared, said


def test_points_that_all_chains_carry_alike_are_shifted_as_one() -> None:
    said = shared.run(("rps", True, 14), seed=3001)
    assert said.steps == (("point_position", "each"),)


def test_a_cubic_about_the_middle_of_its_sensors_needs_no_parabola() -> None:
    """Legs that slide through a part of what their sensors read, not the middle part."""
    said = shared.run(("rps", True, 3), seed=3001)
    assert said.steps == (("cubic", "each.2"),)


def test_a_shared_curve_is_as_large_as_it_is_in_the_readings() -> None:
    """Bases turn by a part of their range, over all of which the curve would be a radian."""
    said = shared.run(("rps", True, 0), seed=0)
    (step,), (ties,) = said.steps, said.ties
    assert ("curvature", "each.1") in (step, *ties)
    assert said.verdict == "explained"


def test_a_shared_parameter_is_asked_for_by_its_target() -> None:
    terms = ["offset", "gain", "link_length@each/2"]
    found = rsicalib.calibrate(READINGS, rest=REST, terms=terms)
    (parameter,) = [p for p in found.parameters if p.term == "link_length"]
    assert (parameter.target, parameter.unit) == ("each/2", "in")
    with pytest.raises(InputError, match="each/2"):
        rsicalib.calibrate(READINGS, terms=["link_length@each/9"])


# ------------------------------------------------------------------ suppose


def test_what_is_supposed_is_what_the_simulator_of_families_computes() -> None:
    case = trials.make("hardening", 1, seed=2)
    device, effect = case.device, case.effects[0]
    mechanism = Mechanism.from_toml(case.text).with_terms([Term.from_dict(LAWS["hardening"].entry)])
    clean = trials.observe(device, case.session.scene, np.random.default_rng(1))
    noise = {c.name: float(s) for c, s in zip(mechanism.channels, device.noise, strict=True)}
    readings = readings_of(mechanism, clean)
    found = suppose(readings, [f"{effect.told}.c={effect.size}"], mechanism, noise=noise)
    expected = Linear(device, case.session.scene).noncentrality(effect)
    # Offsets and gains are those that a fit has found, and the law is linear in its size.
    assert found.noncentrality == pytest.approx(expected, rel=0.05)
    assert np.sum(found.residuals**2) == pytest.approx(found.noncentrality, rel=1e-6)


def test_what_is_noticed_is_the_tail_of_the_noncentral_chi_square() -> None:
    dof = rsicalib.calibrate(READINGS, rest=REST).fit.dof
    assert dof is not None
    for size in (0.0005, 0.002):
        found = suppose(READINGS, [f"curvature@a22.c2={size}"], rest=REST)
        expected = ncx2.sf(chi2.isf(0.001, dof), dof, found.noncentrality)
        assert found.noticed == pytest.approx(expected, abs=0.02)
        assert 0.0 <= found.seen <= 1.0


def test_a_plan_says_what_its_poses_would_show(capsys: pytest.CaptureFixture[str]) -> None:
    term = "curvature@a22.c2=0.02"
    with pytest.raises(SystemExit) as left:
        main(["suppose", str(READINGS), "--term", term, "--json"])
    assert left.value.code == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "rsicalib.supposition/1"
    assert found["effects"][0]["parameters"] == [{"name": "c2", "value": 0.02, "unit": "rad"}]
    assert len(found["residuals"]) == len(found["poses"]) > 10


@pytest.mark.parametrize(
    ("term", "words"),
    [
        ("curvature@a22", "TERM@TARGET.PARAMETER=VALUE"),
        ("curvature=0.1", "a22"),
        ("curvature@a99=0.1", "a99"),
        ("once_per_turn@a22=0.1", "a, b"),
        ("lag@a22=0.1", "recording in motion"),
    ],
)
def test_what_cannot_be_supposed_is_refused(term: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        suppose(READINGS, [term], noise=1.0)
    assert words in str(refused.value)


def test_the_gallery_shows_every_term_as_suppose_draws_it() -> None:
    assert make_gallery.PAGE.read_text(encoding="utf-8") == make_gallery.text()
    there = {path.stem for path in make_gallery.PICTURES.glob("*.svg")}
    assert there == set(make_gallery.drawn())
    dots = (make_gallery.PICTURES / "curvature.svg").read_text(encoding="utf-8")
    assert dots == make_gallery.picture_of("curvature")


def test_families_have_the_legs_that_are_alike() -> None:
    drawing = FAMILIES["rps"](np.random.default_rng(0))
    mechanism = Mechanism.from_dict(drawing.mechanism)
    link = next(t for t in rsicalib.terms(mechanism) if t["id"] == "link_length")
    assert [t for t in link["targets"] if t.startswith("each")] == ["each/1", "each/2", "each/3"]


@pytest.mark.parametrize("form", ["n_per_turn", "step", "none"])
def test_the_closed_form_of_a_curve_is_named_and_only_where_there_is_one(form: str) -> None:
    every = [curves.run((form, k), seed=5) for k in range(sized(3, 4))]
    heard = [row for row in every if row.curve or row.periodic]
    assert len(heard) >= 2  # else a named term does as well
    assert sum(row.right for row in heard) >= len(heard) - 1
    for row in heard:
        if row.order is not None and form == "n_per_turn":
            order, sd = row.order
            assert abs(order - row.place) < 4.0 * sd
