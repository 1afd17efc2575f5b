"""Corrected readings: joint coordinates under the calibration, as CSV or as a bag of ROS 2."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.exports.ask import Ask
from rsicalib.exports.coordinates import coordinates, factor_of, sensor_terms, unit_of
from rsicalib.io.extras import needed
from rsicalib.io.readings import Readings
from rsicalib.work.closing import warn_of_open_loops

TOPIC = "/joint_states"


def _corrected(ask: Ask) -> tuple[Readings, FloatArray]:
    """The readings, and the coordinates that they are under the result."""
    readings = ask.needed("are to be corrected")
    warn_of_open_loops(readings, ask.mechanism, ask.result)
    return readings, coordinates(readings, ask.mechanism, ask.result)


def write_csv(ask: Ask) -> dict[str, str]:
    """Write `corrected.csv`, and the mechanism under which such rows are read as they are."""
    readings, values = _corrected(ask)
    text = replace(readings, values=values, poses=None).csv()
    return {"corrected.csv": text, "corrected.toml": _as_read(ask)}


def _as_read(ask: Ask) -> str:
    """The calibrated mechanism, whose readings are coordinates already."""
    mechanism = ask.calibrated.mechanism
    units = unit_of(mechanism)
    document = mechanism.to_dict()
    for channel in document["channel"]:
        noise = ask.result.noise.sigma[channel["name"]] if ask.result.noise else None
        factor, limits = factor_of(channel), channel.get("limits")
        noise = None if noise is None else noise * abs(channel["gain"]) * factor
        channel["limits"] = None if limits is None else [end * factor for end in limits]
        channel |= {"unit": units[channel["name"]], "gain": 1.0, "offset": 0.0}
        channel |= {"range": None, "noise": noise}
    cleared = {**document, "channel": [_without_none(c) for c in document["channel"]]}
    sensors = sensor_terms(ask.mechanism, ask.result)
    notes = [n for n in ask.calibrated.notes if n.kind != "no_place" or n.term not in sensors]
    said = [
        "readings of corrected.*: joint coordinates",
        *(f"not in here: {n.text}" for n in notes),
    ]
    head = "".join(f"# {' '.join(line.split())}\n" for line in said)
    return head + type(mechanism)(cleared).to_toml()


def _stamps(readings: Readings) -> FloatArray:
    """Times of the messages: ROS 2 counts seconds in 31 bits, from 0."""
    expected = "the time of each row, 0 to 2147483647 s: each message of a bag has one"
    if readings.time_s is None:
        raise InputError.at(readings.source, "no such column", expected, column="time_s")
    bad = np.flatnonzero((readings.time_s < 0) | (readings.time_s >= 2**31))
    if bad.size:
        found = f"{readings.time_s[bad[0]]:g} in sample {bad[0] + 1}"
        raise InputError.at(readings.source, found, expected, column="time_s")
    return readings.time_s


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if value is not None}


def write_mcap(ask: Ask) -> dict[str, bytes | str]:
    """Write `corrected.mcap`, joint states with the corrected positions, and their mechanism."""
    readings, values = _corrected(ask)
    rosbag2 = needed("rosbags.rosbag2", "corrected.mcap", "a bag of ROS 2")
    typesys = needed("rosbags.typesys", "corrected.mcap", "a bag of ROS 2")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    times = _stamps(readings)
    kind, empty = "sensor_msgs/msg/JointState", np.zeros(0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "corrected"
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(path, version=9, storage_plugin=plugin) as bag:
            connection = bag.add_connection(TOPIC, kind, typestore=store)
            for time, row in zip(times.tolist(), values, strict=True):
                stamp = round(time * 1e9)
                header = store.types["std_msgs/msg/Header"](
                    store.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9), ""
                )
                message = store.types[kind](header, list(readings.channels), row, empty, empty)
                bag.write(connection, stamp, store.serialize_cdr(message, kind))
        data = next(path.glob("*.mcap")).read_bytes()
    return {"corrected.mcap": data, "corrected.toml": _as_read(ask)}
