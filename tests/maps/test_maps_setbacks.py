"""Where the stop lines of an X lie, 0 to 8 m before the junction, changes no verdict of the reference autopilot."""

from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.maps.junction import JunctionControl
from pytest_rvads.maps.writer import Layout, opendrive

CASES = [
    (JunctionControl.STOP, "1133", 20.0, 10.0),
    (JunctionControl.STOP, "2132", (0.3, 10.0, 20.0, 30.0), 0.0),
    (JunctionControl.LIGHTS, "1133", 20.0, 10.0),
    (JunctionControl.LIGHTS, "2132", 0.3, 0.0),
]


@pytest.mark.parametrize(("control", "directions", "distance", "speed"), CASES)
def test_same_verdicts(tmp_path: Path, control: JunctionControl, directions: str, distance: float, speed: float) -> None:
    rules = ("p1", "p2", "p3") if control is JunctionControl.STOP else ("p4", "p5", "p6")
    found = {}
    for setback in (0.0, 2.0, 4.0, 8.0):
        path = tmp_path / f"x{setback:.0f}.xodr"
        path.write_text(opendrive(Layout(4, control, setback=setback)), encoding="utf-8")
        scenario = rvads.Scenario("1", directions, distance=distance, speed=speed, map=str(path))
        run = rvads.simulate(scenario, rvads.Reference)
        assert not run.collisions
        assert run.fault is None
        found[setback] = [rvads.check(run, rule).status for rule in rules]
    assert found[2.0] == found[4.0] == found[8.0] == found[0.0]
    assert rvads.Status.PASS in found[0.0]
