"""If this fails, a place that is none is said to be another mistake, and scripts take it for one that time may mend."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.program import main


@pytest.mark.parametrize("place", ["xx", "middle", "ab" * 30])
def test_a_wrong_place_is_wrong_usage_before_a_profile_is_looked_for(
    place: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["node", "run", "--address", "127.0.0.2", "--join-at", place, "--profile", str(tmp_path / "none")]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {place!r} is no place on the line: give ") and said.count("\n") == 1


def test_without_a_profile_a_good_place_is_no_wrong_usage(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = ["node", "run", "--address", "127.0.0.2", "--join-at", "80", "--profile", str(tmp_path / "none")]
    assert main(arguments) == 1
    assert "no cluster profile" in capsys.readouterr().err
