"""Drivers that others wrote, in `clients/foreign`: the shims drive, and a change of the driver's own code removes a finding."""

import importlib
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.naming import chosen

from .carla_copy import carla_copy
from .findings import FINDINGS, FOREIGN, IN_TIME, OWN_LANE, PLAN_KEPT, SEEN_AHEAD, forget, pictured

RULES = ("full_stop", "red", "left_yields", "no_collision", "keep_clear", "progress", "keep_lane", "on_route", "speed_limit")
STATES = [(name, after) for name, finding in FINDINGS.items() for after in (False, True) if finding.after or not after]
"""The findings, before and after the change of CARLA's code."""


@pytest.fixture
def shim(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Return a function that imports a shim anew; the modules of the driver are forgotten before and after."""
    path = sys.path[:]

    def load(name: str, **folders: Path) -> Any:
        forget(path)
        sys.path.insert(0, str(FOREIGN))
        for variable, folder in folders.items():
            monkeypatch.setenv(variable, str(folder))
        return importlib.import_module(name)

    yield load
    forget(path)


@pytest.fixture
def agents(shim: Callable[..., Any], tmp_path: Path) -> Callable[..., Any]:
    """Return a function that imports the shim of CARLA's agents, with changes in a copy of CARLA's files."""
    pytest.importorskip("carla", reason="the wheel carla is not installed")
    pytest.importorskip("shapely", reason="the wheel shapely is not installed")
    folder = os.environ.get("RVADS_CARLA") or pytest.skip("RVADS_CARLA names no folder of CARLA")

    def load(*changes: tuple[str, str, str]) -> Any:
        copy = carla_copy(Path(folder), tmp_path / f"carla{len(list(tmp_path.iterdir()))}", *changes)
        return shim("carla_agents", RVADS_CARLA=copy)

    return load


def failed(driver: Any, junction: str, directions: str, subject: int, speed: float = 8.0) -> dict[str, str]:
    """The rules that a driver breaks among reference traffic, with the first words of their messages."""
    scenario = rvads.Scenario(rvads.find(junction), directions, distance=40, speed=speed, subject=subject)
    run = rvads.simulate(rvads.Case(scenario, driver, traffic=rvads.traffic("reference")))
    assert run.fault is None
    verdicts = {rule: rvads.check(run, rule) for rule in RULES}
    return {rule: verdict.message for rule, verdict in verdicts.items() if verdict.status in ("FAIL", "OPEN")}


@pytest.mark.parametrize("file", sorted(FOREIGN.glob("*.py")), ids=lambda file: file.stem)
def test_shim_is_short(file: Path) -> None:
    assert len(file.read_text(encoding="utf-8").splitlines()) <= 80


@pytest.mark.parametrize(("module", "variable"), [("carla_agents", "RVADS_CARLA"), ("python_robotics", "RVADS_PYTHONROBOTICS")])
def test_missing_folder_is_one_error(module: str, variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(variable, raising=False)
    with pytest.raises(rvads.errors.AutopilotError, match=f"{variable} is not set, expected the folder"):
        chosen(f"{module}:Basic", FOREIGN)


@pytest.mark.extended
@pytest.mark.parametrize("name", ["Basic", "Cautious", "Normal", "Aggressive"])
def test_carla_agent_passes_a_stop_sign(agents: Callable[..., Any], name: str) -> None:
    """CARLA's agents know no stop signs, as the docstring of `BasicAgent` says."""
    assert set(failed(getattr(agents(), name), "stop4", "2000", 0)) == {"full_stop"}


@pytest.mark.parametrize("name", ["Basic", "Cautious", "Normal", "Aggressive"])
def test_carla_agent_travels_to_other_processes(agents: Callable[..., Any], name: str) -> None:
    driver = getattr(agents(), name)
    assert pickle.loads(pickle.dumps(driver)) is driver


@pytest.mark.extended
def test_basic_agent_does_not_see_a_red_light_exactly_ahead(agents: Callable[..., Any]) -> None:
    assert {"red", "keep_clear"} <= set(failed(agents().Basic, "light4", "0200", 1))
    assert not failed(agents(SEEN_AHEAD).Basic, "light4", "0200", 1)


@pytest.mark.extended
def test_behavior_agent_sees_a_red_light_too_late(agents: Callable[..., Any]) -> None:
    assert {"red", "keep_clear"} <= set(failed(agents(SEEN_AHEAD).Normal, "light4", "0200", 1, 10.0))
    assert not {"red", "keep_clear"} & set(failed(agents(SEEN_AHEAD, IN_TIME).Normal, "light4", "0200", 1, 10.0))


@pytest.mark.extended
@pytest.mark.parametrize("name", ["Basic", "Normal"])
def test_carla_agent_turns_left_in_front_of_oncoming_traffic(agents: Callable[..., Any], name: str) -> None:
    """No word of the agents is about the right of way, so no change of a few lines removes this."""
    assert "left_yields" in failed(getattr(agents(), name), "light4", "3020", 0)


@pytest.mark.extended
def test_behavior_agent_leaves_the_road_after_an_emergency_stop(agents: Callable[..., Any]) -> None:
    """An emergency stop does not ask the planner, so points that are passed while braking stay targets, behind the vehicle."""
    assert {"keep_lane", "on_route"} <= set(failed(agents().Normal, "light4", "0200", 1))
    assert not {"keep_lane", "on_route"} & set(failed(agents(PLAN_KEPT).Normal, "light4", "0200", 1))


@pytest.mark.extended
def test_basic_agent_obeys_the_light_of_the_next_lane(agents: Callable[..., Any]) -> None:
    """The left lane of the arm has a light of its own; while one of the two is red the agent stands."""
    assert "progress" in failed(agents().Basic, "lanes4", "20000000", 0)
    assert not failed(agents(OWN_LANE).Basic, "lanes4", "20000000", 0)


@pytest.mark.extended
def test_idm_of_highway_env_gives_way_and_knows_no_stop_sign(shim: Callable[..., Any]) -> None:
    pytest.importorskip("highway_env", reason="the wheel highway-env is not installed")
    idm = shim("highway_env_idm").Idm
    assert set(failed(idm, "stop4", "2222", 0)) == {"full_stop"}
    assert not failed(idm, "yield4", "2222", 0), "entrance 0 has a yield sign"
    assert not failed(idm, "right4", "3000", 0)
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("yield4"), "2222", distance=40, speed=8), idm))
    assert (run.fault, run.collisions) == (None, ())


@pytest.mark.extended
@pytest.mark.parametrize("name", ["Stanley", "Lqr"])
def test_trackers_of_python_robotics_keep_the_lane(shim: Callable[..., Any], name: str) -> None:
    for library in ("scipy", "matplotlib"):
        pytest.importorskip(library, reason=f"PythonRobotics needs {library}")
    if "RVADS_PYTHONROBOTICS" not in os.environ:
        pytest.skip("RVADS_PYTHONROBOTICS names no folder of PythonRobotics")
    tracker = getattr(shim("python_robotics"), name)
    for direction in "123":
        assert not failed(tracker, "right4", f"{direction}000", 0)


@pytest.mark.extended
@pytest.mark.parametrize(("name", "after"), STATES)
def test_picture_in_the_documentation_shows_the_finding(agents: Callable[..., Any], name: str, after: bool) -> None:
    finding = FINDINGS[name]
    status, svg = pictured(finding, agents(*(finding.after if after else finding.before)), after)
    assert (status == "FAIL") is not after
    file = FOREIGN.parents[1] / "docs" / "league" / f"{name}-{'after' if after else 'before'}.svg"
    assert file.read_text(encoding="utf-8") == svg, "python tools/make_league.py --pictures FOLDER draws it anew"


def test_pure_pursuit_of_a_wheel_cuts_corners_as_far_as_it_looks_ahead(shim: Callable[..., Any]) -> None:
    """The default gain was 0.5, says a comment beside its present default of 2.0; with 0.5 the controller keeps its lane."""
    pytest.importorskip("simple_autonomous_car", reason="the wheel simple-autonomous-car is not installed")
    module = shim("simple_car")
    assert "keep_lane" in failed(module.Pursuit, "light3", "100", 0)
    assert "keep_lane" not in failed(module.Short, "light3", "100", 0)
