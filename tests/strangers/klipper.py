"""Configurations of printers, and logs with them."""

from __future__ import annotations

from tests.strangers import Made, text
from tests.test_imports import PRINTER, probes

BODY = PRINTER.split("#*# <")[0]
OLD = BODY.replace("[delta_calibrate]\nradius: 50\n", "")
for line in ("microsteps: 32\n", "microsteps: 16\n", "gear_ratio: 2:1\n"):
    OLD = OLD.replace(line, "")
OLD = OLD.replace("rotation_distance: 60", "step_distance\t=\t.009375 ; measured")
OLD += "[delta_calibrate]\nradius = 50\n" + probes(9).replace("#*# ", "")

LOGGED = "===== Config file =====\n{}\n=======================\nStats 10.2: gcodein=0 mcu: 1\n"
OTHER = LOGGED.format(BODY.replace("332.99", "300.0") + probes(12).replace("#*# ", ""))
KLIPPY = f"Starting Klippy...\n{OTHER}{LOGGED.format(BODY + probes(9).replace('#*# ', ''))}"

MANUAL = "".join(
    f"#*# manual_height{k} = 5.{k}\n#*# manual_height{k}_pos = 34000.0,34001.0,34002.0\n"
    for k in range(3)
)

FILES: dict[str, Made] = {
    # steps as `step_distance`, all in the body, options with `=` and tabs, no saved block
    "an old printer": (text("delta.cfg", OLD), {}, (9, "c")),
    "klippy.log, the last configuration": (text("klippy.log", KLIPPY), {}, (9, "a")),
    "heights by hand beside the probes": (
        text("printer.cfg", PRINTER + probes(9) + MANUAL),
        {},
        (12, "a"),
    ),
    "Windows line ends": (
        text("printer.cfg", (PRINTER + probes(9)).replace("\n", "\r\n")),
        {},
        (9, "b"),
    ),
    "macros with braces and colons": (
        text(
            "printer.cfg",
            "[gcode_macro M]\ngcode:\n  {% set a = {'x': 1} %}\n" + PRINTER + probes(9),
        ),
        {},
        (9, "a"),
    ),
    "no delta": (
        text("printer.cfg", "[printer]\nkinematics: corexy\n[stepper_x]\nx: 1\n"),
        {},
        "line 2, [printer] kinematics: found 'corexy', expected delta",
    ),
    "never probed": (text("printer.cfg", PRINTER), {}, "Run DELTA_CALIBRATE and SAVE_CONFIG"),
    "an include that was not sent": (
        text("printer.cfg", f"[include delta.cfg]\n{PRINTER}{probes(9)}"),
        {},
        "line 1, [include delta.cfg]: found no such file",
    ),
    "a probe cut short": (
        text("printer.cfg", PRINTER + probes(9).rsplit(",", 1)[0]),
        {},
        "heightN_pos".replace("N", "8"),
    ),
    "an angle that is a word": (
        text("printer.cfg", PRINTER.replace("211.5", "left") + probes(9)),
        {},
        "[stepper_a] angle: found 'left', expected a number",
    ),
}
