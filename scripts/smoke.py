"""What a wheel or an sdist does where nothing else is: `python scripts/smoke.py FILE…`.

Makes an empty environment of this interpreter for each file (of a folder: for each in it), installs
the file and what it asks for, imports the package and runs `rsicalib demo`. Standard library only.
"""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import tempfile
import venv
from pathlib import Path

IMPORTED = """
import importlib.metadata, pathlib, rsicalib

assert rsicalib.__version__ == importlib.metadata.version("rsicalib")
for name in rsicalib.__all__:
    getattr(rsicalib, name)
result = rsicalib.load_calibration("report/result.json")
assert result.verdict == "explained", result.verdict
assert pathlib.Path("report/report.html").stat().st_size > 10_000
print("rsicalib", rsicalib.__version__, result.verdict)
"""


def smoke(file: Path) -> None:
    """Install `file` into an empty environment and do the main job there."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        venv.create(here / "env", with_pip=True)
        scripts = sysconfig.get_path("scripts", "venv", {"base": str(here / "env")})

        def run(program: str, *args: str | Path) -> None:
            subprocess.run([Path(scripts) / program, *args], cwd=here, check=True)

        run("python", "-m", "pip", "install", "--quiet", "--only-binary", "numpy", file)
        run("rsicalib", "demo", "--out", "report", "--quiet")
        run("python", "-c", IMPORTED)


def main(names: list[str]) -> None:
    """Every file that is named, and every one in a folder that is named."""
    paths = [Path(name).resolve() for name in names]
    files = [f for p in paths for f in (sorted(p.iterdir()) if p.is_dir() else [p])]
    if not files:
        sys.exit("nothing to install")
    for file in files:
        print(f"== {file.name}, Python {sys.version.split()[0]}", flush=True)
        smoke(file)


if __name__ == "__main__":
    main(sys.argv[1:])
