"""The examples on a map of somebody else: what the user of an own map does."""

import re
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_the_example_of_an_own_map_runs_on_town07(
    pytester: pytest.Pytester, shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RVADS_MAP", str(shared / "maps" / "Town07.xodr"))
    pytester.copy_example(str(EXAMPLES / "test_5_your_own_map.py"))
    result = pytester.runpytest("-v")
    assert result.ret == 0
    named = set(re.findall(r"\[(Town07\.\d+)-", result.stdout.str()))
    assert named == {"Town07.169", "Town07.68"}, "the four-way stop and the four-way lights of facts/maps.md"
    assert result.parseoutcomes()["passed"] >= 6
