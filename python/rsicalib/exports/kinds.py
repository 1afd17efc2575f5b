"""What a result can be written as; what writes it is imported then."""

from __future__ import annotations

EXPORTS = {
    "toml": ("the calibrated mechanism", ""),
    "urdf": ("the robot description that the chains came from", ""),
    "mjcf": ("model of MuJoCo", "mjcf.write"),
    "maslow": ("commands of the firmware of a Maslow4", "maslow.write"),
    "klipper": ("SAVE_CONFIG block of a delta printer", "klipper.write"),
    "lerobot": ("calibration file of a follower; --base is the one that it has", "lerobot.write"),
    "ros2": ("YAML of parameters", "ros2.write"),
    "c": ("header with a function for each channel", "header.write"),
    "csv": ("--readings as joint coordinates", "recordings.write_csv"),
    "mcap": ("--readings as joint states of ROS 2", "recordings.write_mcap"),
}
"""What a result can be written as, in words, and the function of a module here that writes it.

Files of mechanisms and robots are written by the verbs `export_toml` and `export_urdf`.
"""
