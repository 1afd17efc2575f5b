"""Certificates: the budget beside plain differences, the decision, the words, and bad input."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.cli.command import main
from rsicalib.planning.measures import parameters_of
from rsicalib.verbs.certifying import PLACES
from tests.certificates import device, figures

READINGS, REST, CHECK = (DEMO / f"{name}.csv" for name in ("readings", "rest", "check"))


@pytest.fixture(scope="module")
def traced() -> rsicalib.Trace:
    """The demo, checked."""
    return rsicalib.trace(READINGS, rest=REST, check=CHECK)


@pytest.fixture(scope="module")
def unchecked() -> rsicalib.Trace:
    """The demo without its check poses."""
    return rsicalib.trace(READINGS, rest=REST)


@pytest.fixture(scope="module")
def saved(traced: rsicalib.Trace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its file."""
    path = tmp_path_factory.mktemp("certify") / "trace.json"
    traced.save(path)
    return path


def exit_code(words: list[str]) -> object:
    """What the command returns."""
    with pytest.raises(SystemExit) as done:
        main(words)
    return done.value.code or 0


def at(values: dict[str, Any], readings: Any) -> np.ndarray:
    """Positions under a result with other values."""
    return rsicalib.forward(readings, calibration=rsicalib.Trace.from_dict(values))[:, :3]


def by_parameters(values: dict[str, Any], readings: Any, sd: np.ndarray) -> np.ndarray:
    """Derivatives of positions by the parameters of a result: central differences of `forward`."""
    slopes = []
    for one, own in zip(values["parameters"], sd, strict=True):
        step, here = 1e-3 * own, one["value"]
        sides = []
        for sign in (1, -1):
            one["value"] = here + sign * step
            sides.append(at(values, readings))
        one["value"] = here
        slopes.append((sides[0] - sides[1]) / (2 * step))
    return np.array(slopes)


def check_points() -> np.ndarray:
    """The mean readings in the check poses of the demo."""
    readings = rsicalib.load_readings(CHECK)
    labels = np.unique(readings.pose)
    return np.array([readings.values[readings.pose == k].mean(axis=0) for k in labels])


def leaves(
    values: dict[str, Any], seen: np.ndarray, rms: float, warmth: np.ndarray | None = None
) -> float:
    """Make a result leave something, with errors of this size at its check points."""
    values["verdict"] = "partly_explained"
    kept = {"readings": seen.tolist()}
    if warmth is not None:
        kept["temperature_c"] = warmth.tolist()
    values["check_readings"] = kept
    values["after"]["check"]["position_rms"] = rms
    return rms


def factors(
    made: np.ndarray, rms: float, noise: float, coordinates: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """(146) by SciPy's noncentral χ²: factors of draws that make such sums, and their weights."""
    seen, variance = coordinates * rms**2, noise**2
    grid = np.linspace(np.log(1e-7 * seen), np.log(4 * seen + 100 * variance), 5000)
    density = stats.ncx2.pdf(seen / variance, coordinates, np.exp(grid) / variance)
    beyond = np.cumsum(density[::-1])[::-1]
    weight = np.interp(np.log(made), grid, beyond)
    size = np.interp(-weight * rng.uniform(size=len(made)), -beyond, grid)
    return np.sqrt(np.exp(size) / made), weight


def weighted(values: np.ndarray, weight: np.ndarray, p: float) -> float:
    """A quantile of draws with weights."""
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, p * below[-1])])


def told(certificate: rsicalib.Certificate) -> float:
    """How many times as large as predicted errors are said to be."""
    match = re.search(r"([0-9.]+) times what is predicted", certificate.reasons[0])
    assert match is not None, certificate.reasons
    return float(match[1])


@pytest.mark.filterwarnings("ignore::rsicalib.OpenLoopsWarning")
def test_the_expanded_uncertainty_is_that_of_plain_differences_and_draws(
    traced: rsicalib.Trace,
) -> None:
    # Derivatives by central differences of `forward`; draws by numpy. No effect is unseen.
    poses = rsicalib.workspace(traced, poses=40, seed=3).poses
    values = traced.to_dict()
    for hidden in values["could_hide"]:
        if hidden.get("unseen"):
            hidden["unseen"]["probability"] = 0.0
    quiet = rsicalib.Trace.from_dict(values)
    mechanism = rsicalib.load_mechanism("rsi")
    found = rsicalib.certify(quiet, limit=1.0, at=poses).uncertainty
    assert found is not None and found.places == len(poses)

    parameters = parameters_of(quiet, mechanism)
    exact = rsicalib.Device(mechanism, *parameters).readings(poses)
    readings = rsicalib.Readings.from_arrays(mechanism, exact)
    sd = np.sqrt(np.diag(traced.covariance))
    by_parameter = by_parameters(values, readings, sd)
    by_reading = []
    for k, channel in enumerate(mechanism.channels):
        sides = []
        for sign in (1, -1):
            moved = exact.copy()
            moved[:, k] += sign
            sides.append(at(values, rsicalib.Readings.from_arrays(mechanism, moved)))
        by_reading.append((sides[0] - sides[1]) / 2 * traced.noise.sigma[channel.name])
    rng = np.random.default_rng(1)
    n = 4000
    errors = rng.multivariate_normal(np.zeros(len(sd)), traced.covariance, n, method="eigh")
    noise = rng.standard_normal((n, len(poses), 9))
    e = np.einsum("nk,kpi->npi", errors, by_parameter) + np.einsum(
        "npc,cpi->npi", noise, by_reading
    )
    largest = np.linalg.norm(e, axis=2).max(axis=1)
    # The quantiles of 4,000 and of 2,000 draws scatter by 0.6 and 0.8 % of U; 4 of them together.
    assert found.expanded == pytest.approx(np.quantile(largest, 0.95), rel=0.04)
    assert found.median == pytest.approx(np.median(largest), rel=0.02)
    u = np.sqrt(np.einsum("kpi,kl,lpi->p", by_parameter, traced.covariance, by_parameter)).max()
    # Of a result that leaves something, check points say by how much the parameters are off.
    seen = check_points()
    by_check = by_parameters(values, rsicalib.Readings.from_arrays(mechanism, seen), sd)
    made = np.sum(np.einsum("nk,kpi->npi", errors, by_check) ** 2, axis=(1, 2))
    rms = leaves(values, seen, 5 * float(np.sqrt(made.mean() / by_check[0].size)))
    left = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=1.0, at=poses)
    assert left.decision == "within" and "20 check points" in left.reasons[0]
    assert any("unlike the check points" in line for line in left.not_covered)
    read = values["after"]["check"]["largest"]["position_noise"]
    times, weight = factors(made, rms, read, by_check[0].size, rng)
    e = times[:, None, None] * np.einsum("nk,kpi->npi", errors, by_parameter)
    e += np.einsum("npc,cpi->npi", noise, by_reading)
    largest = np.linalg.norm(e, axis=2).max(axis=1)
    assert left.uncertainty is not None
    # The quantiles scatter by 1 and 1.5 %.
    assert left.uncertainty.expanded == pytest.approx(weighted(largest, weight, 0.95), rel=0.06)
    assert told(left) == pytest.approx(weighted(times, weight, 0.5), rel=0.06)
    low, middle, high = (weighted(times, weight, p) for p in (0.159, 0.5, 0.841))
    sources = {one.source: one for one in left.uncertainty.budget if one.effect is None}
    dof = 0.5 / ((high - low) / (2 * middle)) ** 2
    assert sources["parameters"].dof == pytest.approx(dof, rel=0.25)
    assert sources["noise"].dof == found.budget[1].dof
    del values["check_readings"]
    assert rsicalib.certify(rsicalib.Trace.from_dict(values), limit=1.0).decision == "undecided"
    rows = {one.source: one.u for one in found.budget if one.effect is None}
    assert rows["parameters"] <= u * (1 + 1e-4)
    assert found.u == pytest.approx(np.sqrt(sum(one.u**2 for one in found.budget)))


@pytest.mark.filterwarnings("ignore::rsicalib.OpenLoopsWarning")
@pytest.mark.parametrize("aligned", [False, True])
def test_check_points_say_how_large_what_nobody_named_is_at_them(
    traced: rsicalib.Trace, aligned: bool
) -> None:
    # (146): one effect is unseen, and does what an offset of a32 does.
    values = traced.to_dict()
    hidden = [h for h in values["could_hide"] if h.get("unseen")]
    for one in hidden:
        one["unseen"]["probability"] = 0.0
    one = next(h for h in hidden if h["term"] == "temperature_offset")
    names = [(p["term"], p["target"]) for p in values["parameters"]]
    k, size = names.index(("offset", "a32")), 1e-2
    one["unseen"] |= {"probability": 1.0, "mean": [0.0], "covariance": [[size**2]]}
    one["unseen"]["moves"] = [[float(i == k)] for i in range(len(names))]
    mechanism = rsicalib.load_mechanism("rsi")
    seen = check_points()
    warmth = np.full(len(seen), values["reference"]["temperature"])
    sd = np.sqrt(np.diag(traced.covariance))
    places = rsicalib.Readings.from_arrays(mechanism, seen)
    by = by_parameters(values, places, sd)
    rng = np.random.default_rng(2)
    causes = rng.multivariate_normal(np.zeros(len(sd)), traced.covariance, 4000, method="eigh")
    causes[:, k] -= size * rng.standard_normal(4000)
    errors = np.einsum("nk,kpi->npi", causes, by).reshape(4000, -1)
    free = errors.shape[1]
    if aligned:
        where = at(values, places)
        axes = [np.tile(e, len(seen)) for e in np.eye(3)]
        turns = [np.cross(e, where).ravel() for e in np.eye(3)]
        motions = np.linalg.qr(np.stack(axes + turns, axis=1))[0]
        errors -= errors @ motions @ motions.T
        free -= 6
    made = np.sum(errors**2, axis=1)
    rms = leaves(values, seen, 4 * float(np.sqrt(np.median(made) / errors.shape[1])), warmth)
    read = values["after"]["check"]["largest"]["position_noise"]
    part = np.sqrt(errors.shape[1] / free)
    if aligned:
        values["after"]["aligned"] = values["after"]["check"]
    times, weight = factors(made, rms * part, read * part, free, rng)
    poses = [rsicalib.workspace(traced, poses=12, seed=seed).poses for seed in (3, 4)]
    result = rsicalib.Trace.from_dict(values)
    found, other = (rsicalib.certify(result, limit=1.0, at=places) for places in poses)
    assert told(found) == pytest.approx(weighted(times, weight, 0.5), rel=0.06)
    # It is of the check points: of no other places, and not of their orientations.
    assert told(other) == told(found)
    values["after"]["check"]["orientation_rms"] *= 10
    same = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=1.0, at=poses[0])
    assert same.uncertainty == found.uncertainty
    # What noise explains is no reason for more than is predicted.
    values["after"]["check"]["position_rms"] = read
    quiet = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=1.0, at=poses[0])
    predicted = rsicalib.certify(
        rsicalib.Trace.from_dict({**values, "verdict": "explained"}), limit=1.0, at=poses[0]
    )
    assert quiet.uncertainty is not None and predicted.uncertainty is not None
    assert quiet.uncertainty.expanded < 1.1 * predicted.uncertainty.expanded
    assert found.uncertainty is not None
    assert predicted.uncertainty.expanded < 0.75 * found.uncertainty.expanded


def test_what_is_left_open_of_an_effect_is_what_a_fit_with_it_says(
    unchecked: rsicalib.Trace,
) -> None:
    # (141) from the estimate and its deviation in a fit with the effect, and how the others move.
    base = unchecked
    specs = ["offset", "gain", "curvature@a22"]
    before = rsicalib.calibrate(READINGS, rest=REST, terms=specs)
    for term, target in (("cubic", "a11"), ("link_length", "arm2/2"), ("curvature", "a33")):
        hidden = next(h for h in base.could_hide if (h.term, h.target) == (term, target))
        assert hidden.unseen is not None
        fit = rsicalib.calibrate(READINGS, rest=REST, terms=[*specs, f"{term}@{target}"])
        one = fit.parameters[-1]
        assert one.value is not None and one.sd is not None
        typical = next(t for t in rsicalib.terms() if t["id"] == term)["parameters"][0]["typical"]
        if term == "link_length":
            typical *= 4.5  # the longest length of the drawing
        variance = 1 / (typical**-2 + one.sd**-2)
        assert hidden.unseen.covariance[0][0] == pytest.approx(variance, rel=0.05)
        mean = variance * one.value / one.sd**2
        assert hidden.unseen.mean[0] == pytest.approx(mean, abs=0.1 * np.sqrt(variance))
        moved = before.values - fit.values[:-1]
        wanted = np.array(hidden.unseen.moves)[:, 0] * one.value
        # First order: what is left is small beside the deviations.
        sd = np.sqrt(np.diag(before.covariance))
        assert np.all(np.abs(moved - wanted) < 0.1 * sd + 0.05 * np.abs(moved))
    # What does next to nothing is left out; the rest are probabilities.
    assert 0.5 < sum(h.unseen.probability for h in base.could_hide if h.unseen) <= 1


def test_a_limit_is_decided_beyond_the_uncertainty_alone(
    traced: rsicalib.Trace, unchecked: rsicalib.Trace
) -> None:
    at_places = rsicalib.workspace(traced, poses=20, seed=3).poses
    found = rsicalib.certify(traced, limit=1.0, at=at_places)
    assert found.uncertainty is not None
    pandas = pytest.importorskip("pandas")
    as_frame = pandas.DataFrame(at_places, columns=list("xyz") + ["rx", "ry", "rz"])
    assert rsicalib.certify(traced, limit=1.0, at=as_frame).uncertainty == found.uncertainty
    expanded = found.uncertainty.expanded
    assert found.decision == "within" and found.exit_code == 0 and found.decides is None
    assert rsicalib.certify(traced, limit=1.001 * expanded, at=at_places).decision == "within"
    undecided = rsicalib.certify(traced, limit=0.999 * expanded, at=at_places)
    assert (undecided.decision, undecided.exit_code) == ("undecided", 3)
    (known,) = undecided.known
    assert known.expanded is not None and known.poses == 20
    # (144) of the noise of a mean of eight: a coordinate scatters by as much as one reading of the
    # budget over √8, but for where the poses are.
    noise = next(s.u for s in undecided.uncertainty.budget if s.source == "noise")  # type: ignore[union-attr]
    longest = np.sqrt(stats.chi2.ppf(0.95 ** (1 / 20), 3)) * noise / np.sqrt(3 * 8)
    assert 0.5 * longest < known.expanded < 1.1 * longest
    beyond = rsicalib.certify(traced, limit=0.9 * (known.error - known.expanded), at=at_places)
    assert (beyond.decision, beyond.exit_code) == ("not within", 4)
    # Without check points it cannot be shown, and is not said.
    assert rsicalib.certify(unchecked, limit=1e-6, at=at_places).decision == "undecided"
    assert unchecked.quality.check is None
    # The largest of the check poses is that of `forward`.
    readings = rsicalib.load_readings(CHECK)
    assert readings.poses is not None
    labels = np.unique(readings.pose)
    means = np.array([readings.values[readings.pose == k].mean(axis=0) for k in labels])
    poses = np.array([readings.poses[readings.pose == k][0] for k in labels])
    mechanism = rsicalib.load_mechanism("rsi")
    off = at(traced.to_dict(), rsicalib.Readings.from_arrays(mechanism, means)) - poses[:, :3]
    assert known.error == pytest.approx(np.linalg.norm(off, axis=1).max(), rel=1e-6)


def test_more_confidence_more_places_and_units(traced: rsicalib.Trace) -> None:
    sizes, default = [], None
    for options in ({"confidence": 0.9}, {}, {"confidence": 0.99}):
        one = rsicalib.certify(traced, limit=1.0, **options)  # type: ignore[arg-type]
        assert one.uncertainty is not None and one.uncertainty.places == PLACES
        sizes.append(one.uncertainty.expanded)
        default = one if not options else default
    assert sizes == sorted(sizes)
    length = rsicalib.certify(traced, limit="25.4 mm")
    assert (length.limit, length.unit) == (pytest.approx(1.0), "in")
    angle = rsicalib.certify(traced, limit="5 mrad")
    assert (angle.quantity, angle.unit, angle.limit) == ("orientation", "rad", pytest.approx(5e-3))
    assert angle.uncertainty is not None and 0 < angle.uncertainty.expanded < 0.1
    assert default is not None
    assert default.to_dict() == rsicalib.certify(traced, limit=1.0).to_dict()


@pytest.mark.parametrize("verdict", ["unexplained", "partly_explained", "undetermined", "unjudged"])
def test_a_result_that_does_not_predict_its_error_certifies_nothing(
    traced: rsicalib.Trace, verdict: str
) -> None:
    values = {**traced.to_dict(), "verdict": verdict}
    del values["after"]["check"]  # without which nothing says how large the errors are
    places = rsicalib.workspace(traced, poses=12, seed=3).poses
    found = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=10.0, at=places)
    assert found.decision == "undecided" and verdict in found.reasons[0]


def test_a_calibration_is_not_enough(traced: rsicalib.Trace) -> None:
    found = rsicalib.certify(rsicalib.calibrate(READINGS, rest=REST), limit=10.0)
    assert found.decision == "undecided" and "certify a trace" in found.reasons[0]
    old = traced.to_dict()
    for hidden in old["could_hide"]:
        hidden.pop("unseen", None)
    found = rsicalib.certify(rsicalib.Trace.from_dict(old), limit=10.0)
    assert found.decision == "undecided" and "trace again" in found.reasons[0]


@pytest.mark.filterwarnings("ignore::rsicalib.OpenLoopsWarning")
def test_what_changes_between_placements_is_a_part_of_its_own(traced: rsicalib.Trace) -> None:
    poses = rsicalib.workspace(traced, poses=1, seed=8).poses
    values = traced.to_dict()
    size = 0.01
    changing = {"term": "offset", "target": "a11", "name": "offset", "sd": size, "unit": "rad"}
    values["between"] = {
        "kind": "placement",
        "groups": ["a", "b", "c"],
        "sd": 1.0,
        "interval": [0.1, 2.0],
        "p_value": 0.01,
        "parameters": [changing],
        "covariance": (4.0 * np.asarray(traced.covariance)).tolist(),
    }
    other = rsicalib.Trace.from_dict(values)
    rows = []
    for one in (traced, other):
        found = rsicalib.certify(one, limit=1.0, at=poses).uncertainty
        assert found is not None
        rows.append({s.source: s.u for s in found.budget if s.effect is None})
    assert rows[1]["parameters"] == pytest.approx(2 * rows[0]["parameters"])
    assert "between placements" not in rows[0]
    mechanism = rsicalib.load_mechanism("rsi")
    exact = rsicalib.Device(mechanism, *parameters_of(traced, mechanism)).readings(poses)
    sides = []
    for sign in (1, -1):
        moved = traced.to_dict()
        assert moved["parameters"][0]["target"] == "a11"
        moved["parameters"][0]["value"] += sign * 1e-4
        sides.append(at(moved, rsicalib.Readings.from_arrays(mechanism, exact)))
    slope = np.linalg.norm(sides[0] - sides[1]) / 2e-4
    assert rows[1]["between placements"] == pytest.approx(size * slope, rel=1e-3)


def test_an_effect_that_is_not_applied_and_has_no_size_certifies_nothing(
    traced: rsicalib.Trace,
) -> None:
    values = traced.to_dict()
    assert rsicalib.certify(rsicalib.Trace.from_dict(values), limit=10.0).decision == "within"
    values["steps"][0] |= {"applied": False, "platform_rms": None}
    found = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=10.0)
    assert found.decision == "undecided" and "curvature of sensor a22" in found.reasons[0]
    # Check points that stand in for an explanation do not stand in for its size.
    values = traced.to_dict() | {"verdict": "partly_explained"}
    values["steps"][0] |= {"applied": False, "platform_rms": {"position": None, "orientation": 0.0}}
    found = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=10.0)
    assert found.decision == "undecided"
    assert any("curvature of sensor a22" in reason for reason in found.reasons)


def test_an_effect_that_is_not_applied_is_known(traced: rsicalib.Trace) -> None:
    values = traced.to_dict()
    values["steps"][0]["applied"] = False
    known = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=1.0).known
    assert known[-1].source == "effects not applied"
    size = values["steps"][0]["platform_rms"]["position"]
    assert known[-1].error == pytest.approx(np.sqrt(3) * size)


def test_it_says_whose_places_it_is_of(traced: rsicalib.Trace) -> None:
    assert rsicalib.certify(traced, limit=1.0).conditions[0].startswith("Places of the platform: ")
    from rsicalib.verbs import certifying

    delta = rsicalib.load_mechanism("delta")
    assert "carriage a, carriage b and carriage c" in certifying._conditions(traced, delta, "")[0]
    assert any("place of nozzle" in line for line in certifying._not_covered(traced, delta, False))


def test_the_command_prints_its_document_and_its_plan_works_when_pasted(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["certify", str(saved), "--limit", "0.018", "--json", "--out", str(tmp_path / "out")]
    assert exit_code(words) == 3
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "rsicalib.certificate/1"
    assert document["uncertainty"]["budget"][0]["source"] == "parameters"
    assert document["decides"].startswith("plan ")
    assert document == json.loads((tmp_path / "out" / "certificate.json").read_text())
    assert exit_code(["certify", str(saved), "--limit", "1 mm"]) == 0
    assert "within 0.0394" in capsys.readouterr().out.replace("0.0393701", "0.0394")
    assert exit_code([*shlex.split(document["decides"]), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["poses"]) == 6


def test_places_come_from_files_of_readings_or_of_poses(
    saved: Path, traced: rsicalib.Trace, tmp_path: Path
) -> None:
    poses = rsicalib.workspace(traced, poses=5).poses
    file = tmp_path / "poses.csv"
    rows = [",".join(f"{v:.17g}" for v in pose) for pose in poses]
    file.write_text("\n".join(["x,y,z,rx,ry,rz", *rows]) + "\n")
    by_file, by_array = (rsicalib.certify(saved, limit=1.0, at=one) for one in (file, poses))
    assert by_file.uncertainty == by_array.uncertainty
    by_readings = rsicalib.certify(saved, limit=1.0, at=CHECK)
    assert by_readings.uncertainty is not None and by_readings.uncertainty.places == 160


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"limit": -1.0}, "found -1.0, expected a length [in] above 0"),
        ({"limit": 0}, "expected a length [in] above 0"),
        ({"limit": "0.5 kg"}, "found '0.5 kg'"),
        ({"limit": "half an inch"}, "found 'half an inch'"),
        ({"limit": "0.5.1 mm"}, "found '0.5.1 mm'"),
        ({"limit": float("nan")}, "found nan"),
        ({"limit": 1.0, "confidence": 1.5}, "confidence: found 1.5"),
        ({"limit": 1.0, "at": [[50.0, 0, 0, 0, 0, 0]]}, "found pose 1 (50, 0, 0, 0, 0, 0)"),
        ({"limit": 1.0, "at": [[0.0, 0, 0]]}, "shape (1, 3), expected numbers of shape (n, 6)"),
        ({"limit": 1.0, "mechanism": "delta"}, "found a calibration of"),
    ],
)
def test_what_cannot_be_certified_is_refused(
    traced: rsicalib.Trace, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError) as error:
        rsicalib.certify(traced, **options)
    assert words in str(error.value)


def test_files_that_cannot_be_used_are_refused_by_their_place(saved: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    plan.write_text('{"format": "rsicalib.plan/1"}')
    with pytest.raises(InputError, match=r"plan\.json, format: found .rsicalib\.plan/1."):
        rsicalib.certify(plan, limit=1.0)
    file = tmp_path / "poses.csv"
    file.write_text("x,y,z,rx,ry,rz\n0,0,-2,0,0,0\n0,0,low,0,0,0\n")
    with pytest.raises(InputError, match=r"line 3, column z: found 'low', expected a number"):
        rsicalib.certify(saved, limit=1.0, at=file)
    file.write_text("x,y,z\n0,0,-2\n")
    with pytest.raises(InputError, match="column rx: found no such column"):
        rsicalib.certify(saved, limit=1.0, at=file)


def test_the_sheet_says_what_is_signed(traced: rsicalib.Trace) -> None:
    found = rsicalib.certify(traced, limit=0.018)
    page, text = found.report(), found.text()
    assert found.uncertainty is not None
    for words in (
        found.data_sha256,
        "Undecided",
        "noise of a reading",
        "20 poses",
        "Scale:",
        "plan",
    ):
        assert words in page
    assert "Undecided" in text and "rsicalib plan" in text
    # Words, no specs; the limit and U on one scale; room to sign.
    assert "@" not in text and "@" not in page.split("<main>")[1]
    assert 'id="decision"' in page and "limit 0.018 in" in page and "Signature" in page
    assert "<script>" not in found.report().split("<main>")[1].split("</main>")[0]


def test_the_small_form_of_the_campaign_runs() -> None:
    # The full form is `python -m tests.certificates`: of two devices nothing is counted.
    rows = [device(number, 5, more=number == 0) for number in range(2)]
    assert "2 devices" in figures(rows)
    assert any(row.before.expanded for row in rows)


@pytest.mark.filterwarnings("ignore::rsicalib.OpenLoopsWarning")
def test_an_effect_of_temperature_that_nobody_named_counts_beyond_the_session(
    traced: rsicalib.Trace,
) -> None:
    values, rng = traced.to_dict(), np.random.default_rng(4)
    warmth = values["reference"]["temperature"]
    left = [h for h in values["could_hide"] if h.get("unseen")]
    one = next(h for h in left if h["term"] == "temperature_offset")
    one["target"] = "a32"
    for hidden in left:
        hidden["unseen"]["probability"] = 0.0
    size, moves = 1e-4, one["unseen"]["moves"]
    one["unseen"] |= {"probability": 1.0, "mean": [0.0], "covariance": [[size**2]]}
    one["unseen"]["moves"] = [[0.0] for _ in moves]
    pose = rsicalib.workspace(traced, poses=1, seed=int(rng.integers(100))).poses
    mechanism = rsicalib.load_mechanism("rsi")
    exact = rsicalib.Device(mechanism, *parameters_of(traced, mechanism)).readings(pose)
    found = {}
    for warmer in (10.0, 20.0):
        place = rsicalib.Readings.from_arrays(
            mechanism, exact, pose=np.array([1]), temperature_c=np.array([warmth + warmer])
        )
        told = rsicalib.certify(rsicalib.Trace.from_dict(values), limit=1.0, at=place).uncertainty
        assert told is not None
        found[warmer] = next(s.u for s in told.budget if s.effect == "temperature_offset@a32")
    (offset,) = (p for p in values["parameters"] if (p["term"], p["target"]) == ("offset", "a32"))
    here, sides = offset["value"], []
    for sign in (1, -1):
        offset["value"] = here + sign * 1e-5
        sides.append(at(values, rsicalib.Readings.from_arrays(mechanism, exact)))
    by_offset = np.linalg.norm(sides[0] - sides[1]) / 2e-5
    assert found[10.0] == pytest.approx(10 * size * by_offset, rel=1e-3)
    assert found[20.0] == pytest.approx(2 * found[10.0], rel=1e-9)
