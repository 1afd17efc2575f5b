"""The simulator of the blind trials, against itself and against devices that it did not make."""

from __future__ import annotations

import csv
import json
import os
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib.errors import OpenLoopsWarning
from tests import oracle
from tests.blind import effects, power, simulator, trials
from tests.blind.effects import Effect
from tests.blind.geometry import Geometry, forward_arm, inverse
from tests.blind.grade import grade
from tests.blind.scene import Scene
from tests.blind.simulator import Device
from tests.full import sized
from tests.oracle import Array

EVERY = effects.CATALOGUE + effects.OUTSIDE + effects.FAULTS


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)


@pytest.fixture
def device(rng: np.random.Generator) -> Device:
    return Device.random(rng)


def scene_for(effect: type[Effect], device: Device, rng: np.random.Generator) -> Scene:
    """A recording for what shows in motion, a session for the rest."""
    return trials.stage(device, rng, effect.moving)


# ------------------------------------------------------------------ the device alone


def test_noise_free_readings_close_the_loop(device: Device, rng: np.random.Generator) -> None:
    scene = scene_for(effects.Curvature, device, rng)
    f = oracle.misclosure(oracle.rsi(), device.offsets, device.gains, device.ideal(scene))
    assert np.abs(f).max() < 1e-10


def test_the_rest_pose_reads_about_mid_range(rng: np.random.Generator) -> None:
    codes = np.array(
        [simulator.rest(Device.random(rng), rng)["values"].mean(axis=0) for _ in range(100)]
    )
    assert abs(codes.mean() - 2048) < 10
    assert 30 < codes.std() < 80


def test_poses_stay_in_reach_and_on_scale(device: Device, rng: np.random.Generator) -> None:
    held = simulator.session(device, rng, simulator.hand_poses(rng, 200, device), samples=1)
    moving = simulator.recording(device, rng)
    for values in (held["values"], moving["values"]):
        assert values.min() > 0
        assert values.max() < 4095
    assert moving["values"].shape == (4000, 9)


def test_the_check_readings_give_the_true_handle_pose(
    device: Device, rng: np.random.Generator
) -> None:
    check = simulator.check(device, rng)
    angles = oracle.angles_of(device.offsets, device.gains, device.ideal(check["scene"]))
    pose = oracle.rsi_pose(oracle.points(oracle.rsi(), angles))
    assert np.abs(pose - check["poses"]).max() < 1e-12


def test_whitened_noise_has_the_declared_size(device: Device, rng: np.random.Generator) -> None:
    session = simulator.session(device, rng, simulator.hand_poses(rng, 200, device), samples=8)
    f = oracle.misclosure(oracle.rsi(), device.offsets, device.gains, session["values"])
    white = power.whitener(device, session["values"], 1.0)
    chi2 = np.sum(np.einsum("nij,nj->ni", white, f) ** 2)
    assert abs(chi2 / f.size - 1) < 5 * np.sqrt(2 / f.size)


def test_tremor_keeps_the_loop_closed(device: Device, rng: np.random.Generator) -> None:
    poses = simulator.hand_poses(rng, 20, device)
    session = simulator.session(device, rng, poses, tremor=(0.01, 0.01))
    counts = device.ideal(session["scene"])
    f = oracle.misclosure(oracle.rsi(), device.offsets, device.gains, counts)
    assert np.abs(f).max() < 1e-10
    assert counts.reshape(20, 8, 9).std(axis=1).mean() > 2


# ------------------------------------------------------------------ what was really built


def test_altered_arms_reach_their_wrists(device: Device, rng: np.random.Generator) -> None:
    poses = simulator.hand_poses(rng, 100, device)
    for kind in effects.STRUCTURE:
        if kind is effects.Sag:
            continue
        for _ in range(5):
            geometry = device.built([kind.draw(rng)])
            angles = inverse(geometry, poses)
            wrists = np.stack([forward_arm(geometry, i, angles[:, i])[0] for i in range(3)], axis=1)
            assert np.abs(wrists - oracle.rsi_wrists(poses, geometry.platform)).max() < 1e-11


def test_the_slope_of_an_arm_is_its_difference(rng: np.random.Generator) -> None:
    geometry = Geometry()
    for kind in (effects.JointTilt, effects.BaseTilt, effects.LinkOffset):
        geometry = kind("arm2/3" if kind is not effects.BaseTilt else "arm2", 0.02).geometry(
            geometry
        )
    angles = rng.uniform(-1, 1, (1, 3))
    _, slope = forward_arm(geometry, 1, angles)
    other = oracle.richardson(lambda q: forward_arm(geometry, 1, q[None])[0][0], angles[0])
    assert np.abs(slope[0] - other).max() < 1e-9


def test_load_bends_an_arm_downwards(device: Device) -> None:
    poses = np.array([oracle.REST])
    soft = effects.Sag("all", 0.001).geometry(Geometry())
    sensed = inverse(soft, poses)[0]
    unloaded = [forward_arm(Geometry(), i, sensed[None, i])[0][0, 2] for i in range(3)]
    assert np.all(np.array(unloaded) > -2.666)


def test_a_longer_side_changes_only_that_side() -> None:
    built = effects.Distance("wrist2-wrist3", 0.1).geometry(Geometry()).platform
    side = oracle.L4 * np.sqrt(3)
    assert np.linalg.norm(built[1] - built[2]) == pytest.approx(side + 0.1, abs=1e-12)
    assert np.linalg.norm(built[0] - built[1]) == pytest.approx(side, abs=1e-12)
    assert np.linalg.norm(built[0] - built[2]) == pytest.approx(side, abs=1e-12)


# ------------------------------------------------------------------ effects


@pytest.mark.parametrize("kind", EVERY, ids=lambda kind: kind.__name__)
def test_an_effect_of_size_zero_does_nothing(
    kind: type[Effect], device: Device, rng: np.random.Generator
) -> None:
    scene = scene_for(kind, device, rng)
    none = kind.draw(rng).resized(0.0)
    plain = device.ideal(scene)
    assert np.abs(device.ideal(scene, [none]) - plain).max() < 1e-9
    codes = np.rint(plain).astype(np.int64)
    assert np.array_equal(none.codes(codes), codes)


@pytest.mark.parametrize("kind", EVERY, ids=lambda kind: kind.__name__)
def test_an_effect_is_the_same_whenever_asked(
    kind: type[Effect], device: Device, rng: np.random.Generator
) -> None:
    scene = scene_for(kind, device, rng)
    effect = kind.draw(rng)
    assert np.array_equal(device.ideal(scene, [effect]), device.ideal(scene, [effect]))
    codes = np.rint(device.ideal(scene)).astype(np.int64)
    changed = not np.array_equal(device.ideal(scene, [effect]), device.ideal(scene))
    assert changed or not np.array_equal(effect.codes(codes), codes)


@pytest.mark.parametrize("kind", effects.SENSOR[:4], ids=lambda kind: kind.__name__)
def test_a_sensor_law_holds_at_the_reading(
    kind: type[Effect], device: Device, rng: np.random.Generator
) -> None:
    scene = scene_for(kind, device, rng)
    effect = kind.draw(rng)
    counts = device.ideal(scene, [effect])
    angles = oracle.angles_of(device.offsets, device.gains, counts) + effect.law(counts, scene)
    assert np.abs(angles - device.angles(scene)).max() < 1e-12


@pytest.mark.parametrize("name", ["LinkLength", "Curvature", "Drift", "ReferenceDrift", "Sag"])
def test_noncentrality_grows_with_the_square(
    name: str, device: Device, rng: np.random.Generator
) -> None:
    kind = getattr(effects, name)
    session = simulator.session(device, rng, simulator.hand_poses(rng, 24, device), samples=2)
    effect = kind.draw(rng)
    small = power.noncentrality(device, session, effect.resized(effect.size / 10))
    large = power.noncentrality(device, session, effect.resized(effect.size / 5))
    assert large / small == pytest.approx(4, rel=0.02)
    scaled = power.scaled_to(device, session, effect, 60.0)
    assert power.noncentrality(device, session, scaled) == pytest.approx(60.0, rel=0.02)


def test_offset_and_gain_have_no_noncentrality(device: Device, rng: np.random.Generator) -> None:
    """A change of gain about mid-range is what the model has already."""

    class Gain(effects.Curvature):
        def angle(self, count: Array, scene: Scene) -> Array:
            out: Array = self.size * (count - 1000.0)
            return out

    session = simulator.session(device, rng, simulator.hand_poses(rng, 48, device), samples=1)
    assert power.noncentrality(device, session, Gain("a12", 1e-7)) < 1e-3


def test_noncentrality_is_the_mean_growth_of_chi_square(
    device: Device, rng: np.random.Generator
) -> None:
    """Refitted to first order, χ² of simulated sessions grows by it on average."""
    poses = simulator.hand_poses(rng, 30, device)
    effect = effects.LinkLength("arm1/4", 0.03)
    session = simulator.session(device, rng, poses, samples=1)
    wanted = power.noncentrality(device, session, effect)

    def chi2(values: Array) -> float:
        f = oracle.misclosure(oracle.rsi(), device.offsets, device.gains, values)
        white = power.whitener(device, values, 1.0)
        by_offset = oracle.jacobians(oracle.rsi(), device.offsets, device.gains, values)[0]
        by_gain = by_offset * (values[:, None] - 2048.0)
        columns = np.concatenate([white @ by_offset, white @ by_gain], axis=2)
        r = np.einsum("nij,nj->ni", white, f).ravel()
        matrix = columns.reshape(-1, 18)
        matrix = matrix / np.linalg.norm(matrix, axis=0)
        left = r - matrix @ np.linalg.lstsq(matrix, r, rcond=None)[0]
        return float(left @ left)

    growth = [
        chi2(simulator.session(device, rng, poses, samples=1, effects=[effect])["values"])
        - chi2(simulator.session(device, rng, poses, samples=1)["values"])
        for _ in range(sized(20, 60))
    ]
    assert abs(np.mean(growth) - wanted) < 4 * np.std(growth) / np.sqrt(len(growth)) + 0.1 * wanted


# ------------------------------------------------------------------ trials and grades


def test_a_case_is_the_same_for_the_same_seed() -> None:
    first, again, other = (trials.make("single", 3, seed) for seed in (1, 1, 2))
    assert first.effects == again.effects
    assert np.array_equal(first.readings["values"], again.readings["values"])
    assert not np.array_equal(first.readings["values"], other.readings["values"])
    assert first.strength[0] >= 0.98 * trials.FLOOR


@pytest.mark.parametrize("suite", trials.SUITES)
def test_every_suite_can_be_made(suite: str) -> None:
    case = trials.make(suite, 2, seed=0)
    assert len(case.effects) == {"clean": 0, "pairs": 2, "triples": 3}.get(suite, 1)
    rows = {"clean": 24 * 2, "recordings": 4000}.get(suite, 48 * 8)
    assert case.readings["values"].shape == (rows, 9)
    assert case.check["poses"].shape == (160, 6)


def said(*steps: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A result that names these steps."""
    verdict = "explained" if steps else "adequate"
    return {"steps": list(steps), "excluded": [], "warnings": [], "verdict": verdict} | more


def step(term: str, kind: str, target: str, *also: tuple[str, str, str]) -> dict[str, Any]:
    """A step, and what it also fits."""
    names = [{"term": t, "class": k, "target": at} for t, k, at in also]
    return {"term": term, "class": kind, "target": target, "also_fits": names}


def test_grading_wants_class_and_target() -> None:
    truth = [effects.Curvature("a22", 0.02)]
    assert grade(said(step("cubic", "sensor", "a22")), truth).right
    assert not grade(said(step("curvature", "sensor", "a23")), truth).right
    assert not grade(said(step("sag", "load", "a22")), truth).right
    assert grade(said(), truth).effects[0].credit == 0


def test_credit_is_divided_by_the_targets_listed() -> None:
    truth = [effects.LinkLength("arm2/4", 0.02)]
    vague = step("curvature", "sensor", "a23", ("link_length", "geometry", "arm2/4"))
    found = grade(said(vague), truth)
    assert found.effects[0].credit == 0.5
    assert found.extras == 0
    shape = step("link_length", "geometry", "arm2/4", ("link_offset", "geometry", "arm2/4"))
    assert grade(said(shape), truth).effects[0].credit == 1


def test_an_explanation_of_another_class_misleads() -> None:
    truth = [effects.Drift("a11", 0.02)]
    wrong = said(step("link_length", "geometry", "arm1/2"))
    assert grade(wrong, truth).misled
    assert not grade(wrong | {"verdict": "partly_explained"}, truth).misled
    assert not grade(said(step("slip", "sensor", "a11")), truth).misled


def test_what_is_not_there_is_extra() -> None:
    truth = [effects.Drift("a11", 0.02)]
    result = said(step("drift", "sensor", "a11"), step("sag", "load", "all"))
    assert grade(result, truth).extras == 1
    assert grade(said(step("drift", "sensor", "a11")), []).flagged
    assert not grade(said(), []).flagged


def test_a_bad_reading_must_be_excluded_by_pose_and_channel() -> None:
    truth = [effects.BadReading("a31", 50.0, pose=7)]
    entry = {"pose": 7, "sample": None, "chain": "arm3", "channel": "a31"}
    assert grade(said(excluded=[entry]), truth).right
    arm = grade(said(excluded=[entry | {"channel": None}]), truth)
    assert arm.effects[0].credit == pytest.approx(1 / 3)
    nothing = entry | {"channel": None, "chain": None}
    assert grade(said(excluded=[nothing]), truth).effects[0].credit == pytest.approx(1 / 9)
    wrong = grade(said(excluded=[entry | {"pose": 8}]), truth)
    assert wrong.effects[0].credit == 0
    assert wrong.extras == 1


def test_outside_the_catalogue_only_the_place_counts() -> None:
    truth = [effects.Ripple("a12", 0.01)]
    assert grade(said(unexplained={"target": "a12"}), truth).effects[0].credit == 1
    near = grade(said(step("link_length", "geometry", "arm1/2")), truth)
    assert near.effects[0].credit == 0
    assert [v.arm for v in near.effects] == [1.0]


def test_a_spoilt_converter_may_be_left_out_or_warned_of() -> None:
    truth = [effects.FAULTS[0]("a12", 1.0)]
    entry = {"pose": None, "sample": None, "chain": "arm1", "channel": "a12"}
    assert grade(said(excluded=[entry]), truth).right
    assert grade(said(warnings=[{"kind": "stuck_bit", "target": "a12"}]), truth).right
    wrong = grade(said(excluded=[entry | {"channel": "a13"}]), truth)
    assert wrong.extras == 1
    assert wrong.effects[0].credit == 0


def test_handle_errors_come_from_the_check() -> None:
    before = {"check": {"poses": 20, "position_rms": 0.02, "orientation_rms": 0.01}}
    found = grade(said(before=before, after={}), [])
    assert found.position == (0.02, None)
    assert found.orientation == (0.01, None)


# ------------------------------------------------------------------ where what is left lies


def left_over(effect: Effect, number: int) -> str:
    """What is said of an effect when no term at all may explain it."""
    every = tuple(term["id"] for term in rsicalib.terms())
    case = trials.staged([5, number], effect, exactly=500.0, without=every)
    result = trials.examine(case)
    assert result["verdict"] == "unexplained"
    assert result["unexplained"]["target"] == effect.target
    text: str = result["unexplained"]["text"]
    return text


def test_what_depends_on_the_direction_of_approach_is_said_to() -> None:
    text = left_over(effects.Hysteresis("a22", 2.0), 1)
    assert "its sign is that of the direction in which a22 came" in text


def test_what_lies_at_some_readings_is_said_to() -> None:
    spot = effects.WornSpot("a32", 0.02, centre=0.1)
    text = left_over(spot, 2)
    found = re.search(r"where a32 reads (\d+) to (\d+) count", text)
    assert found is not None, text
    low, high = map(float, found.groups())
    assert low < 2048 + 1000 * spot.centre < high


# ------------------------------------------------------------------ devices made by others


def given_devices() -> Path | None:
    """The folder of devices from another simulator: `$RSICALIB_DEVICES`, or one found nearby."""
    if "RSICALIB_DEVICES" in os.environ:
        return Path(os.environ["RSICALIB_DEVICES"])
    root = Path(__file__).resolve().parents[1]
    near = [*root.glob("data/rsi"), *root.glob("*/data/rsi"), *root.parent.glob("*/data/rsi")]
    return next((folder for folder in near if (folder / "truth.json").exists()), None)


DEVICES = given_devices()
needs_devices = pytest.mark.skipif(DEVICES is None, reason="devices of another simulator not here")


def load(name: str, truth: dict[str, Any]) -> tuple[Device, Scene, Array]:
    """True device, scene without poses, and readings (n, 9) of a given session."""
    assert DEVICES is not None
    with (DEVICES / name / "readings.csv").open() as file:
        rows = list(csv.DictReader(file))

    def column(key: str) -> Array:
        return np.array([float(row[key]) for row in rows])

    values = np.stack([column(channel) for channel in effects.CHANNELS], axis=1)
    device = Device(np.ravel(truth["off"]), np.ravel(truth["gain"]))
    held = "pose" in rows[0]
    label = column("pose").astype(int) if held else np.arange(1, len(rows) + 1)
    scene = Scene(
        pose=np.zeros((len(rows), 6)),
        label=label,
        sample=column("sample").astype(int) if held else np.ones_like(label),
        before=(label - 2) * 8 if held else label - 2,
        time_s=column("time_s"),
        temperature_c=column("temperature_c") if held else np.full(len(rows), 21.0),
        held=held,
    )
    return device, scene, values


def unexplained(
    device: Device, scene: Scene, values: Array, declared: list[Effect]
) -> tuple[float, float]:
    """Reduced χ² per sample, and between poses, of the readings about the nearest handle poses.

    Every sample gets the handle pose that fits it best (6 of its 9 readings), by Gauss-Newton
    through the simulator; what is left has 3 degrees of freedom.
    """
    angles = oracle.angles_of(device.offsets, device.gains, values)
    pose = oracle.rigid_pose(oracle.points(oracle.rsi(), angles))

    def reads(at: Array) -> Array:
        return device.ideal(Scene(**{**vars(scene), "pose": at}), declared)

    for _ in range(4):
        here = reads(pose)
        slope = np.stack(
            [(reads(pose + 1e-5 * axis) - reads(pose - 1e-5 * axis)) / 2e-5 for axis in np.eye(6)],
            axis=-1,
        )
        pose = pose + (np.linalg.pinv(slope) @ (values - here)[..., None])[..., 0]
    left = (values - reads(pose)) / np.sqrt(1 + power.QUANTISATION)
    count = np.bincount(scene.label)[1:]
    means = np.stack([np.bincount(scene.label, column)[1:] for column in left.T], axis=1)
    between = np.sum(means**2 / count[:, None]) / (3 * len(count))
    return float(np.sum(left**2) / (3 * len(left))), float(between)


DECLARED: dict[str, type[Effect] | None] = {
    "clean": None,
    "curved": effects.Curvature,
    "long_forearm": effects.LinkLength,
    "drifting_reference": effects.ReferenceDrift,
    "shaky": effects.LinkLength,
}
TARGET = {"curved": "a22", "long_forearm": "arm3/4", "drifting_reference": "all", "shaky": "arm1/2"}


@needs_devices
@pytest.mark.parametrize("name", DECLARED)
def test_given_devices_are_explained_by_their_declared_effect(name: str) -> None:
    assert DEVICES is not None
    truth = json.loads((DEVICES / "truth.json").read_text())[name]
    device, scene, values = load(name, truth)
    kind = DECLARED[name]
    declared = [] if kind is None else [kind(TARGET[name], truth["b"])]
    samples, between = unexplained(device, scene, values, declared)
    # Five standard deviations of χ² per degree of freedom: 1152 of samples, 144 of poses.
    assert abs(samples - 1) < 5 * np.sqrt(2 / 1152)
    assert abs(between - 1) < 5 * np.sqrt(2 / 144)
    if declared:
        reversed_sign = [declared[0].resized(-declared[0].size)]
        assert unexplained(device, scene, values, [])[1] > 2
        assert unexplained(device, scene, values, reversed_sign)[1] > 2


@needs_devices
def test_a_given_recording_closes_at_the_truth() -> None:
    assert DEVICES is not None
    truth = json.loads((DEVICES / "truth.json").read_text())["waved"]
    device, _, values = load("waved", truth)
    f = oracle.misclosure(oracle.rsi(), device.offsets, device.gains, values)
    white = power.whitener(device, values, 1.0)
    chi2 = np.sum(np.einsum("nij,nj->ni", white, f) ** 2) / f.size
    assert abs(chi2 - 1) < 5 * np.sqrt(2 / f.size)


@pytest.mark.parametrize("number", range(sized(3, 20)))
def test_a_hand_that_trembles_by_six_degrees_leaves_a_sound_device_adequate(number: int) -> None:
    """Each sample closes; the mean of the readings of a pose does not, by 5 times their noise."""
    rng = np.random.default_rng([4711, number])
    device = Device.random(rng)
    scene = trials.stage(device, rng, False, trials.Conditions(poses=40, tremor=(0.1, 0.1)))
    it = trials.given(trials.recorded("clean", number, device, scene, rng, ()))
    for verb in (rsicalib.calibrate, rsicalib.trace):
        found = verb(it.readings, it.mechanism, check=it.check, rest=it.rest)
        assert (found.verdict, found.reasons) == ("adequate", ())
    with warnings.catch_warnings():
        warnings.simplefilter("error", OpenLoopsWarning)
        rsicalib.forward(it.readings, it.mechanism, calibration=found)
