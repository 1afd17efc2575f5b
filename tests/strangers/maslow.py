"""Serial logs of a Maslow, and what people make of them."""

from __future__ import annotations

import gzip
import json

from tests.strangers import Made, text
from tests.test_imports import clbm, sled

ROWS = [dict(zip(("tl", "tr", "bl", "br"), map(float, row), strict=True)) for row in sled()]
LIST = clbm(sled())

CONSOLE = "start\r\n" + "},\r\n".join(
    f"Tue Oct 14 22:{k:02} {line}" for k, line in enumerate(LIST.split("},"))
)

FILES: dict[str, Made] = {
    # lines copied from the page, with a time before each, and Windows line ends
    "console of a browser": (
        text("calibration-log-ui.txt", f"{CONSOLE}\r\nFitness: 2.356\r\nMaslow_tlX: 0.6\r\n"),
        {},
        (25, "tl"),
    ),
    # a program that logs each position when it comes, in a list of its own
    "a list for each position": (
        text("run.log", "\n".join(clbm([row]) for row in sled())),
        {},
        (25, "tl"),
    ),
    "JSON of a script": (
        text("belts.json", json.dumps([dict(sorted(row.items())) for row in ROWS])),
        {},
        (25, "br"),
    ),
    "JSON of an editor": (text("pretty.json", json.dumps(ROWS, indent=2)), {}, (25, "tr")),
    "JSON with more around": (
        text("run.json", json.dumps({"run": 1, "points": ROWS}, indent=1)),
        {},
        (25, "bl"),
    ),
    "colours of a terminal": (text("run.log", f"\x1b[0;32m{LIST}\x1b[0m\n"), {}, (25, "tl")),
    "a message amid the list": (
        text("run.log", LIST.replace("},{", "},[MSG:INFO: x]{", 1)),
        {},
        (25, "tl"),
    ),
    "a lost colon": (
        text("run.log", LIST.replace("tr:", "tr", 1)),
        {},
        "line 1, position 1: found 'tr",
    ),
    "a lost brace": (text("run.log", LIST.replace("},{", ",{", 1)), {}, "which does not end"),
    "UTF-16 of Windows": (text("run.log", LIST.encode("utf-16")), {}, "UTF-16"),
    "packed": (text("run.log.gz", gzip.compress(LIST.encode())), {}, "packed (gzip): unpack it"),
}
