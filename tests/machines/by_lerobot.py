"""A data set by the library LeRobot itself: `PYTHON tests/machines/by_lerobot.py FOLDER`.

PYTHON is one that has `lerobot` (0.4) and what it needs to write: datasets, draccus, einops,
jsonlines, av, deepdiff, imageio, pyserial, termcolor. Writing needs no torch, but the library
imports it: where it is not there, empty modules stand in its place. rsicalib is not imported.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
import types
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
ROWS, LAG, TICKS = 300, 4, 2600
NOT_NEEDED = ("torch", "torchvision", "torchcodec", "cv2", "safetensors", "accelerate")


class Stands:
    """Finds a module that is not needed, and is not there."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """A module of its name, with whatever is asked of it."""
        if name.split(".")[0] not in NOT_NEEDED:
            return None
        return importlib.machinery.ModuleSpec(name, self, is_package=True)  # type: ignore[arg-type]

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> MagicMock:
        """One whose classes are asked for as bases and in `isinstance`."""
        module = MagicMock(name=spec.name)
        module.__spec__, module.__path__, module.__name__ = spec, [], spec.name
        module.__file__, module.__version__ = "", "2.0.0"
        for name in ("Tensor", "Generator", "FloatTensor", "dtype", "device", "Module", "Dataset"):
            setattr(module, name, type(name, (), {}))
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        """Nothing."""


def positions(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Leader and follower, some rows behind, in percent, shape (rows, joints)."""
    rng = np.random.default_rng(seed)
    t = np.arange(ROWS + LAG)[:, None] / 30
    wave = 60 * np.sin(t * rng.uniform(0.5, 2.0, len(JOINTS)) + rng.uniform(0, 6, len(JOINTS)))
    percent = (np.round((wave + 100) * TICKS / 200) * 200 / TICKS - 100).astype(np.float32)
    return percent[LAG:], percent[:-LAG]


def main(folder: Path) -> None:
    """Write two episodes."""
    importlib.import_module(
        "datasets"
    )  # asks whether torch is there: before something stands for it
    if importlib.util.find_spec("torch") is None:
        sys.meta_path.insert(0, Stands())
        for name in ("torch.utils.data", "torch.nn"):  # bases of classes: no mere attributes
            importlib.import_module(name)
    library = importlib.import_module("lerobot.datasets.lerobot_dataset")

    names = [f"{joint}.pos" for joint in JOINTS]
    feature = {"dtype": "float32", "shape": (len(JOINTS),), "names": names}
    features = {"action": feature, "observation.state": feature}
    made = library.LeRobotDataset.create(
        "me/pick",
        fps=30,
        features=features,
        root=folder,
        robot_type="so101_follower",
        use_videos=False,
    )
    for seed in (0, 1):
        for action, state in zip(*positions(seed), strict=True):
            made.add_frame({"action": action, "observation.state": state, "task": "pick"})
        made.save_episode()
    made.finalize()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
