"""What a result can be written as; what writes it is imported then."""

from __future__ import annotations

EXPORTS = {
    "toml": "the calibrated mechanism",
    "urdf": "the robot description that the chains came from",
    "mjcf": "model of MuJoCo",
    "maslow": "commands of the firmware of a Maslow4",
    "klipper": "SAVE_CONFIG block of a delta printer",
    "lerobot": "calibration file of a follower; --base is the one that it has",
    "ros2": "YAML of parameters",
    "c": "header with a function for each channel",
    "csv": "--readings as joint coordinates",
    "mcap": "--readings as joint states of ROS 2",
}
"""What a result can be written as."""
