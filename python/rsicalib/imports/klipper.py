"""Klipper: the probed heights and measured distances of a delta printer, from `printer.cfg`.

`DELTA_CALIBRATE` leaves the steps of each tower from its endstop at which the nozzle met the bed
(`heightN_pos`) in the block that `SAVE_CONFIG` writes; the geometry is in the same file.
`DELTA_ANALYZE` leaves distances of a printed object (`distanceN`), each between two positions in
steps (`distanceN_pos1`, `distanceN_pos2`), at which the nozzle is on no bed.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked, chosen
from rsicalib.imports.klipper_config import TOWERS, Config, read_config
from rsicalib.imports.log import Column, Log, Session

ANGLES = {"a": 210.0, "b": 330.0, "c": 90.0}
"""Angles of the towers [°] where the file has none: Klipper's own."""

FULL_STEPS = 200.0
TEETH = 1e6
"""More than a gear has."""

CALIPER = 0.05
"""Standard deviation of a distance that was measured on a printed object [mm]: a caliper's reading,
and the edge of a printed line."""

Probe = tuple[float, list[float], int]
"""A height or a distance, the steps of the towers, and where it stands in the file."""

UNKNOWNS = 9
"""Endstops and radius, two angles, three arms."""


def read(source: str, asked: Asked) -> Log:
    """Read the probes of a printer, and its geometry as a mechanism.

    Raises
    ------
    InputError
        It is no delta printer, or it was not probed.
    """
    config = read_config(source)
    kinematics = config.text("printer", "kinematics")
    if kinematics != "delta":
        raise config.refuse("printer", "kinematics", "delta")
    probes = [p for kind in ("manual_height", "height") for p in _measured(config, kind, "_pos")]
    if not probes:
        hint = "Run DELTA_CALIBRATE and SAVE_CONFIG first."
        expected = "heights and steps: height0, height0_pos, …"
        raise InputError.at(source, "none", expected, hint=hint, place="[delta_calibrate]")
    height, _ = Counter(h for h, _, _ in probes).most_common(1)[0]
    ends = [_measured(config, "distance", end) for end in ("_pos1", "_pos2")]
    if ends[0]:
        return _with_distances(config, asked, probes, ends)
    # Towers are upright: a nozzle that is higher stands as one at the common height whose carriages
    # are all that much lower. Gains of the drawing are good enough for the few millimetres.
    steps_per_mm = [1.0 / _step(config, f"stepper_{tower}") for tower in TOWERS]
    above = np.array([h for h, _, _ in probes]) - height
    values = np.array([steps for _, steps, _ in probes]) + above[:, None] * steps_per_mm
    findings = _findings(len(probes), int(np.count_nonzero(above)), height)
    return _log(config, asked, probes, values, height, findings)


def _log(
    config: Config,
    asked: Asked,
    rows: list[Probe],
    values: FloatArray,
    height: float,
    findings: tuple[str, ...],
    lengths: Sequence[tuple[str, float]] = (),
    beside: Mapping[str, Column] | None = None,
) -> Log:
    """Rows with these readings of the towers, each a pose, and the mechanism that they are of."""
    labels = {name: [text] * len(rows) for name, text in asked.labels.items()}
    places = chosen(asked.channels, TOWERS, config.source, "tower")
    columns: dict[str, Column] = {"pose": np.arange(len(rows), dtype=np.int64), **labels}
    columns |= {channel: values[:, k] for channel, k in places.items()} | dict(beside or {})
    session = Session(columns, np.array([line for _, _, line in rows]))
    digest = hashlib.sha256("".join(map(str, config.values.items())).encode()).hexdigest()
    text = mechanism(config, height, lengths) if tuple(places) == TOWERS else None
    name = "delta printer of Klipper"
    return Log(config.source, name, (session,), text, findings, sha256=digest)


def _findings(probes: int, elsewhere: int, height: float) -> tuple[str, ...]:
    out = []
    if probes < UNKNOWNS:
        out.append(
            f"{probes} probes for {UNKNOWNS} unknowns (endstops and radius, two angles, three "
            "arms): they do not determine all of them; probe more points (points: in "
            "[delta_calibrate])"
        )
    if height:
        out.append(f"the nozzle is {height:g} mm above the bed at each probe: its offset")
    if elsewhere:
        out.append(
            f"{elsewhere} of {probes} probes are at another height than {height:g} mm: their "
            "carriages are moved by the difference, as towers are upright"
        )
    return tuple(out)


def _measured(config: Config, kind: str, end: str) -> list[Probe]:
    """What was measured of one kind, in its order, with the position at one end."""
    found: list[Probe] = []
    while config.text("delta_calibrate", f"{kind}{len(found)}") is not None:
        name = f"{kind}{len(found)}"
        value = config.number("delta_calibrate", name)
        line = config.line("delta_calibrate", name)
        found.append((value, config.steps(f"{name}{end}"), line))
    return found


def _with_distances(
    config: Config, asked: Asked, probes: list[Probe], ends: list[list[Probe]]
) -> Log:
    """Heights, and pairs of positions on a printed object: the nozzle is on no bed there."""
    at = [f"height{k}" for k in range(len(probes))]
    at += [f"distance{k}{end}" for k in range(len(ends[0])) for end in "ab"]
    pairs = [one for pair in zip(*ends, strict=True) for one in pair]
    rows = [*probes, *pairs]
    values = np.array([steps for _, steps, _ in rows])
    heights = np.array([h for h, _, _ in probes] + [np.nan] * len(pairs))
    lengths = [(f"distance{k}", value) for k, (value, _, _) in enumerate(ends[0])]
    findings = (
        f"{len(probes)} heights and {len(lengths)} distances of a printed object, which are taken "
        f"to be known to {CALIPER:g} mm (`noise` of their closures)",
    )
    beside: dict[str, Column] = {"touch": at, "height": heights}
    return _log(config, asked, rows, values, 0.0, findings, lengths, beside)


def mechanism(config: Config, height: float, distances: Sequence[tuple[str, float]]) -> str:
    """Mechanism file of the printer: three carriages on towers, three arms, a nozzle on the bed.

    With distances of a printed object the nozzle has a place for each `touch`, two of which are so
    far apart, and it is on the bed, or as high above it as it says, where there is a `height`.

    A carriage is at `position_endstop + √(arm² - radius²) - steps · step` above the bed.
    """
    radius = config.number("printer", "delta_radius")
    first_arm = config.number("stepper_a", "arm_length")
    first_stop = config.number("stepper_a", "position_endstop")
    channels, chains, points, closures = [], [], [], []
    for tower in TOWERS:
        section = f"stepper_{tower}"
        arm = config.number(section, "arm_length", first_arm)
        if not arm > radius > 0.0:
            raise config.refuse(section, "arm_length", f"more than the radius, {radius:g}")
        stop = config.number(section, "position_endstop", first_stop)
        angle = config.number(section, "angle", ANGLES[tower])
        carriage = stop + math.sqrt(arm**2 - radius**2)
        gain = -_step(config, section)
        channels.append(
            f'{{name = "{tower}", unit = "step", gain = {gain!r}, offset = {carriage!r}, '
            "noise = 1.0}"
        )
        chains.append(
            f'{{name = "tower {tower}", dh = [{{theta = {math.radians(angle)!r}, a = {radius!r}}}, '
            f'{{channel = "{tower}", joint = "prismatic"}}]}}'
        )
        points.append(
            f'{{name = "carriage {tower}", chain = "tower {tower}", at = [0.0, 0.0, 0.0]}}'
        )
        closures.append(
            f'{{name = "arm {tower}", kind = "distance", '
            f'between = ["carriage {tower}", "nozzle"], value = {arm!r}}}'
        )
    each = "touch" if distances else "pose"
    points.append(f'{{name = "nozzle", unknown = ["{each}"], at = [0.0, 0.0, 0.0]}}')
    above = ', value = "height"' if distances else ""
    closures.append(
        '{name = "nozzle on bed", kind = "plane", between = ["nozzle", "bed"], noise = 0.03'
        f"{above}}}"
    )
    closures += [
        f'{{name = "{name}", kind = "distance", between = ["nozzle[touch={name}a]", '
        f'"nozzle[touch={name}b]"], value = {value!r}, noise = {CALIPER!r}}}'
        for name, value in distances
    ]

    def listed(name: str, entries: list[str]) -> str:
        return f"{name} = [\n" + "".join(f"  {entry},\n" for entry in entries) + "]\n"

    return (
        "# A delta printer: steps are counted from the endstops, downwards.\n"
        'name = "delta printer"\nlength_unit = "mm"\n'
        + listed("channel", channels)
        + listed("chain", chains)
        + listed("point", points)
        + listed("closure", closures)
        + "\n[[plane]]                        # normal · p = offset\n"
        + f'name = "bed"\nnormal = [0.0, 0.0, 1.0]\noffset = {height!r}\n'
        + '\n[model]\nterms = ["offset"]\n'
    )


def _step(config: Config, section: str) -> float:
    """What one step moves the carriage [mm]; an older file has it as it is."""
    old = config.text(section, "step_distance")
    if old is not None and config.text(section, "rotation_distance") is None:
        return config.above_zero(section, "step_distance")
    names = {"rotation_distance": None, "microsteps": None, "full_steps_per_rotation": FULL_STEPS}
    # the towers b and c may leave out what they share with a
    sections = {n: section if config.text(section, n) is not None else "stepper_a" for n in names}
    rotation, micro, full = (config.above_zero(sections[n], n, d) for n, d in names.items())
    gears = 1.0
    text = config.text(section, "gear_ratio") or config.text("stepper_a", "gear_ratio") or "1:1"
    for pair in text.split(","):
        try:
            driven, driving = map(float, pair.split(":"))
        except ValueError:
            driven, driving = 0.0, 0.0
        if not (0.0 < driven < TEETH and 0.0 < driving < TEETH):
            raise config.refuse(section, "gear_ratio", "teeth such as 80:20, 3:1")
        gears *= driven / driving
    step = rotation / full / micro / gears
    if not (0.0 < step < math.inf and 1.0 / step < math.inf):
        raise config.refuse(section, "rotation_distance", "a step that is a length")
    return step
