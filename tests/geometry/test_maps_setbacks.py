"""Where the stop lines of an X lie, 0 to 8 m before the junction, changes no verdict of the reference autopilot."""

from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.scenarios.classes import classes, label
from tools.crossings import Layout, opendrive

SETBACKS = (0.0, 2.0, 4.0, 8.0)
CASES = [
    (JunctionControl.STOP, "1133", 20.0, 10.0),
    (JunctionControl.STOP, "2132", (0.3, 10.0, 20.0, 30.0), 0.0),
    (JunctionControl.LIGHTS, "1133", 20.0, 10.0),
    (JunctionControl.LIGHTS, "2132", 0.3, 0.0),
]


def same_verdicts(
    folder: Path, control: JunctionControl, directions: str, distance: Any, speed: float, setbacks: tuple[float, ...] = SETBACKS
) -> set[rvads.Status]:
    """Check that all rules say the same for all setbacks, among them 0; return what they say."""
    rules = ("p1", "p2", "p3") if control is JunctionControl.STOP else ("p4", "p5", "p6")
    found = {}
    for setback in setbacks:
        path = folder / f"x{setback:.0f}.xodr"
        folder.mkdir(exist_ok=True)
        if not path.exists():
            path.write_text(opendrive(Layout(4, control, setback=setback)), encoding="utf-8")
        scenario = rvads.Scenario(rvads.find("1", str(path)), directions, distance=distance, speed=speed)
        assert scenario.place.setbacks == pytest.approx((setback,) * 4, abs=1e-6)
        run = rvads.simulate(rvads.Case(scenario, rvads.Reference))
        assert not run.collisions
        assert run.fault is None
        found[setback] = [rvads.check(run, rule).status for rule in rules]
    assert all(statuses == found[0.0] for statuses in found.values()), found
    return set(found[0.0])


@pytest.mark.extended
@pytest.mark.parametrize(("control", "directions", "distance", "speed"), CASES)
def test_same_verdicts(tmp_path: Path, control: JunctionControl, directions: str, distance: float, speed: float) -> None:
    assert rvads.Status.PASS in same_verdicts(tmp_path, control, directions, distance, speed)


@pytest.mark.extended
def test_same_verdicts_in_a_third_of_the_classes(tmp_path: Path) -> None:
    kinds = (JunctionControl.STOP, JunctionControl.LIGHTS)
    said = []
    for k, code in enumerate(list(classes(4))[::3]):
        control = kinds[k % 2]
        said.append(same_verdicts(tmp_path / control.value, control, label(code), 20.0, 10.0, setbacks=(0.0, 8.0)))
    assert rvads.Status.PASS in set().union(*said)


@pytest.mark.slow
@pytest.mark.parametrize("control", [JunctionControl.STOP, JunctionControl.LIGHTS])
@pytest.mark.parametrize(("distance", "speed"), [(0.3, 0.0), (20.0, 0.0), (20.0, 10.0), ((0.3, 20.0, 0.3, 20.0), 0.0)])
def test_same_verdicts_in_all_classes(tmp_path: Path, control: JunctionControl, distance: Any, speed: float) -> None:
    said = [same_verdicts(tmp_path, control, label(code), distance, speed) for code in classes(4)]
    assert len(said) == 24
    # Four that stop at once all have somebody on their right, so p2 fails there for whoever goes first.
    assert rvads.Status.PASS in set().union(*said)
