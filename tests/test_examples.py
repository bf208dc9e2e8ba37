"""The examples on a map of somebody else: what the user of an own map does."""

import re
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.extended
def test_the_example_of_an_own_map_runs_on_town07(
    pytester: pytest.Pytester, shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RVADS_MAP", str(shared / "maps" / "Town07.xodr"))
    monkeypatch.setenv("COLUMNS", "200")
    for name in ("conftest.py", "test_5_your_own_map.py"):
        pytester.copy_example(str(EXAMPLES / name))
    result = pytester.runpytest("-v")
    assert result.ret == 0
    named = set(re.findall(r"\[(Town07\.\d+)-", result.stdout.str()))
    assert named == {"Town07.169", "Town07.68"}, "the four-way stop and a four-way lights of facts/maps.md"
    result.stdout.fnmatch_lines(["1 junction left out: no scenario has room for its vehicles where they would start: Town07.725"])
    assert result.parseoutcomes()["passed"] >= 6


@pytest.mark.parametrize(
    ("junction", "named"),
    [("169", "Town07.169"), ("4-way all-way stop with 30 m of approach", "Town07.169"), ("430", "Town07.430")],
)
def test_junctions_of_a_file_work_like_built_in_ones(pytester: pytest.Pytester, shared: Path, junction: str, named: str) -> None:
    file = str(shared / "maps" / "Town07.xodr")
    pytester.makepyfile(
        f"""
        import pytest_rvads as rvads

        @rvads.scenario(junction={junction!r}, map={file!r}, classes=2, grid="E", rules=("p1", "p3"))
        def test_stop(run, rule, monitor):
            assert monitor.check(rule)
        """
    )
    result = pytester.runpytest("-v")
    result.assert_outcomes(passed=2)
    assert set(re.findall(r"\[(\S+?)-class02-", result.stdout.str())) == {named}


@pytest.mark.parametrize(
    ("file", "junction", "says"),
    [
        ("connected_junctions_simple.xodr", "100", "is itself part of junction"),
        ("Town07.xodr", "453", "it has 2 arms"),
        ("Town07.xodr", "1690", "did you mean '169'"),
        ("XCrossStopAllWay.xodr", "1", "no <junction>"),
        ("direct_junction_simple.xodr", "4", "of type"),
    ],
)
def test_what_can_t_be_used_is_said_at_collection(
    pytester: pytest.Pytester, shared: Path, file: str, junction: str, says: str
) -> None:
    pytester.makepyfile(
        f"""
        import pytest_rvads as rvads

        @rvads.scenario({junction!r}, map={str(shared / "maps" / file)!r})
        def test_it(run): ...
        """
    )
    result = pytester.runpytest()
    assert result.ret == pytest.ExitCode.INTERRUPTED
    assert says in result.stdout.str()
    assert "Traceback" not in result.stdout.str()
