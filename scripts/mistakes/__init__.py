"""Mistakes that people make with the command, and what ought to come of each.

Each mistake begins from a folder with good files: `readings.csv`, `rest.csv` and `check.csv` of the
demo, `result.json` calibrated from them and `rsi.toml`. It damages a copy, runs one command there
as a user would, and expects an exit code and a part of the message. `scripts/make_mistakes.py`
writes the page, `tests/test_mistakes.py` runs them as tests.
"""
