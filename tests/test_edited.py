"""Results whose values were edited: `python -m tests.edited` tries as many as wanted."""

from __future__ import annotations

from pathlib import Path

from tests.edited import run


def test_an_edited_result_is_refused_or_told_or_gives_the_poses_that_it_gave(
    tmp_path: Path,
) -> None:
    counts, faults = run(800, 1, tmp_path)
    assert faults == []
    assert min(counts["refused"], counts["told"], counts["as good"]) > 20
