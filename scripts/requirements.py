"""Print what the package and some of its extras need: `python scripts/requirements.py test,docs`.

For `scripts/setup.sh`, which installs them while the core compiles.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path


def main(extras: str = "") -> None:
    """One requirement a line, each once."""
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(text)["project"]
    wanted = list(project["dependencies"])
    for extra in filter(None, extras.split(",")):
        wanted += project["optional-dependencies"][extra]
    print("\n".join(dict.fromkeys(wanted)))


if __name__ == "__main__":
    main(*sys.argv[1:])
