"""Klipper: the probed heights of a delta printer, from `printer.cfg`.

`DELTA_CALIBRATE` leaves the steps of each tower from its endstop at which the nozzle met the bed
(`heightN_pos`) in the block that `SAVE_CONFIG` writes; the geometry is in the same file.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked, chosen
from rsicalib.imports.log import Column, Log, Session
from rsicalib.io.sources import read_text

__all__ = ["ANGLES", "TOWERS", "Config", "read", "read_config"]

TOWERS = ("a", "b", "c")
ANGLES = {"a": 210.0, "b": 330.0, "c": 90.0}
"""Angles of the towers [°] where the file has none: Klipper's own."""

AUTOSAVE = "#*#"
FULL_STEPS = 200.0
UNKNOWNS = 9
"""Endstops and radius, two angles, three arms."""


@dataclass(frozen=True)
class Config:
    """Values of a configuration: section, option, text and where it stands."""

    source: str
    values: dict[tuple[str, str], tuple[str, str, int]]

    def text(self, section: str, option: str) -> str | None:
        """An option as it stands there; None where it is not."""
        found = self.values.get((section, option))
        return None if found is None else found[0]

    def refuse(self, section: str, option: str, expected: str) -> InputError:
        """What is wrong with an option."""
        text, source, line = self.values.get((section, option), (None, self.source, None))
        found = "no such option" if text is None else repr(text)
        place = f"[{section}] {option}"
        return InputError.at(
            source, line=line, column=place, found=found, expected=expected, column_word=""
        )

    def number(self, section: str, option: str, default: float | None = None) -> float:
        """An option as a number."""
        text = self.text(section, option)
        if text is None and default is not None:
            return default
        try:
            value = float(text or "")
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.refuse(section, option, "a number")
        return value

    def steps(self, option: str) -> list[float]:
        """Steps of the three towers."""
        text = self.text("delta_calibrate", option) or ""
        try:
            steps = [float(part) for part in text.split(",")]
        except ValueError:
            steps = []
        if len(steps) != len(TOWERS) or not np.isfinite(steps).all():
            expected = "three numbers with commas between them: steps of the towers a, b, c"
            raise self.refuse("delta_calibrate", option, expected)
        return steps

    def line(self, section: str, option: str) -> int:
        """Where an option stands."""
        return self.values[section, option][2]


def read_config(source: str) -> Config:
    """Read a configuration with the files that it includes; the body wins over the saved block."""
    body: dict[tuple[str, str], tuple[str, str, int]] = {}
    saved: dict[tuple[str, str], tuple[str, str, int]] = {}
    _read_into(Path(source), body, saved, ())
    return Config(source, {**saved, **body})


def _read_into(
    path: Path,
    body: dict[tuple[str, str], tuple[str, str, int]],
    saved: dict[tuple[str, str], tuple[str, str, int]],
    above: tuple[Path, ...],
) -> None:
    section = ""
    for number, raw in enumerate(read_text(path, "a configuration of Klipper").splitlines(), 1):
        automatic = raw.startswith(AUTOSAVE)
        line = re.split(r"(?:^|\s)[#;]", raw[len(AUTOSAVE) * automatic :])[0].strip()
        head = re.fullmatch(r"\[([^\]]+)\]", line)
        if head:
            section = head[1].strip()
            if section.startswith("include "):
                pattern = section.removeprefix("include ").strip()
                found = sorted(path.parent.glob(pattern))
                if not found and not set(pattern) & set("*?["):
                    where = f"[{section}]"
                    raise InputError.at(
                        str(path),
                        line=number,
                        column=where,
                        found="no such file",
                        expected="the file that is included",
                        column_word="",
                    )
                for file in found:
                    if file not in above:
                        _read_into(file, body, saved, (*above, path))
            continue
        option = re.match(r"([^\s:=][^:=]*?)\s*[:=]\s*(.*)", line)
        if option and not raw[:1].isspace():
            value = (option[2].strip(), str(path), number)
            (saved if automatic else body)[section, option[1].lower()] = value


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
    probes = []
    for kind in ("manual_height", "height"):
        number = 0
        while config.text("delta_calibrate", f"{kind}{number}") is not None:
            height = config.number("delta_calibrate", f"{kind}{number}")
            line = config.line("delta_calibrate", f"{kind}{number}")
            probes.append((height, config.steps(f"{kind}{number}_pos"), line))
            number += 1
    if not probes:
        hint = "Run DELTA_CALIBRATE and SAVE_CONFIG first."
        expected = "heights and steps: height0, height0_pos, …"
        raise InputError.at(
            source,
            column="[delta_calibrate]",
            found="none",
            expected=expected,
            hint=hint,
            column_word="",
        )
    height, _ = Counter(h for h, _, _ in probes).most_common(1)[0]
    used = [(steps, line) for h, steps, line in probes if h == height]
    values = np.array([steps for steps, _ in used])
    pose = np.arange(len(values), dtype=np.int64)
    labels = {name: [text] * len(pose) for name, text in asked.labels.items()}
    places = chosen(asked.channels, TOWERS, source, "tower")
    columns: dict[str, Column] = {"pose": pose, **labels}
    columns |= {channel: values[:, k] for channel, k in places.items()}
    session = Session(columns, np.array([line for _, line in used]))
    digest = hashlib.sha256("".join(map(str, config.values.items())).encode()).hexdigest()
    findings = _findings(config, len(probes), len(used), height)
    text = mechanism(config, height) if tuple(places) == TOWERS else None
    return Log(source, "delta printer of Klipper", (session,), text, findings, sha256=digest)


def _findings(config: Config, probes: int, used: int, height: float) -> tuple[str, ...]:
    out = []
    if used < UNKNOWNS:
        out.append(
            f"{used} probes for {UNKNOWNS} unknowns (endstops and radius, two angles, three arms): "
            "they do not determine all of them; probe more points (points: in [delta_calibrate])"
        )
    if height:
        out.append(f"the nozzle is {height:g} mm above the bed at each probe: its offset")
    if used < probes:
        out.append(f"{probes - used} probes at another height than {height:g} mm are not used")
    if config.text("delta_calibrate", "distance0") is not None:
        out.append("distances of the printed object are not used: they need pairs of poses")
    return tuple(out)


def mechanism(config: Config, height: float) -> str:
    """Mechanism file of the printer: three carriages on towers, three arms, a nozzle on the bed.

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
    points.append('{name = "nozzle", unknown = ["pose"], at = [0.0, 0.0, 0.0]}')
    closures.append(
        '{name = "nozzle on bed", kind = "plane", between = ["nozzle", "bed"], noise = 0.03}'
    )

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
        return config.number(section, "step_distance")
    names = {"rotation_distance": None, "microsteps": None, "full_steps_per_rotation": FULL_STEPS}
    # the towers b and c may leave out what they share with a
    sections = {n: section if config.text(section, n) is not None else "stepper_a" for n in names}
    rotation, micro, full = (config.number(sections[n], n, d) for n, d in names.items())
    gears = 1.0
    text = config.text(section, "gear_ratio") or config.text("stepper_a", "gear_ratio") or "1:1"
    for pair in text.split(","):
        try:
            driven, driving = map(float, pair.split(":"))
            gears *= driven / driving
        except (ValueError, ZeroDivisionError):
            raise config.refuse(section, "gear_ratio", "teeth such as 80:20, 3:1") from None
    return rotation / (full * micro * gears)
