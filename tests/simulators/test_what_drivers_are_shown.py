"""What drivers are handed can't be changed, so that no driver changes the world, the next run, or its judges."""

import copy
import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.simulators.simulator import simulate

SCENARIO = rvads.Scenario(rvads.find("light4"), "1231", distance=20, duration=0.05)
WITH_PEDESTRIAN = SCENARIO.but(place=rvads.find("walk4"), pedestrians=[rvads.Pedestrian(0)])


def looked(scenario: rvads.Scenario = SCENARIO) -> tuple[rvads.Observation, tuple[rvads.Agent, ...]]:
    """Return what a traffic system and its autopilots were shown."""
    shown: list[Any] = []

    class Looks(rvads.TrafficSystem):
        def autopilots(self, agents: Any) -> Any:
            shown.append(agents)
            return [self] * len(agents)

        def control(self, seen: rvads.Observation) -> rvads.Control:
            shown.append(seen)
            return rvads.Control(brake=1.0)

    run = simulate(rvads.Case(scenario, Looks))
    assert run.fault is None
    return shown[-1], shown[0]


def parts(value: Any, path: str = "seen", met: dict[int, Any] | None = None) -> Iterator[tuple[str, Any]]:
    """Walk everything that can be reached from a value by its public names; each object with fields is met once."""
    met = {} if met is None else met
    if is_dataclass(value):
        if id(value) in met:
            return
        met[id(value)] = value
    yield path, value
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from parts(item, f"{path}[{key}]", met)
    elif isinstance(value, tuple | frozenset):
        for number, item in enumerate(value):
            yield from parts(item, f"{path}[{number}]", met)
    elif is_dataclass(value):
        names = [field.name for field in fields(value)]
        names += [name for name, kind in vars(type(value)).items() if hasattr(kind, "func")]  # cached properties
        for name in names:
            yield from parts(getattr(value, name), f"{path}.{name}", met)


PLAIN = (str, int, float, bool, type(None), Enum, tuple, frozenset, MappingProxyType)


@pytest.mark.parametrize("scenario", [SCENARIO, WITH_PEDESTRIAN], ids=["vehicles", "with a pedestrian"])
def test_observations_are_read_only(scenario: rvads.Scenario) -> None:
    kinds = set()
    for path, value in parts(looked(scenario)):
        kinds.add(type(value).__name__)
        if isinstance(value, np.ndarray):
            with pytest.raises(ValueError, match="cannot set WRITEABLE"):
                value.setflags(write=True)
        elif is_dataclass(value):
            assert value.__dataclass_params__.frozen, path  # type: ignore[union-attr]
        else:
            assert isinstance(value, PLAIN), f"{path} is a {type(value).__name__}"
    assert {"Observation", "Junction", "Segment", "ndarray", "mappingproxy", "Vehicle", "Agent"} <= kinds


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda seen: seen.junction.movements.pop((0, 1)), id="a movement taken away"),
        pytest.param(lambda seen: seen.junction.by_turn.clear(), id="a table emptied"),
        pytest.param(lambda seen: seen.itinerary.path.points.__setitem__(0, 7.0), id="a centre line moved"),
        pytest.param(lambda seen: setattr(seen.vehicle, "mass", 1.0), id="a lighter vehicle"),
    ],
)
def test_writing_to_an_observation_is_a_fault_of_that_run(change: Callable[[rvads.Observation], object]) -> None:
    class Changes(rvads.Reference):
        def control(self, seen: rvads.Observation) -> rvads.Control:
            change(seen)
            return super().control(seen)

    before = simulate(rvads.Case(SCENARIO, rvads.Reference)).hash
    fault = simulate(rvads.Case(SCENARIO, Changes)).fault
    assert fault is not None
    assert "Changes driving a0 raised" in fault.reason
    assert simulate(rvads.Case(SCENARIO, rvads.Reference)).hash == before


@pytest.mark.parametrize("again", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))], ids=["copy", "pickle"])
def test_copies_are_equal_and_as_read_only(again: Callable[[Any], Any]) -> None:
    junction, copied = SCENARIO.place, again(SCENARIO.place)
    assert copied == junction
    assert copied.digest == junction.digest
    assert type(copied.movements) is MappingProxyType
    line = copied.way_through(0, 2)
    assert np.array_equal(line.points, junction.way_through(0, 2).points)
    with pytest.raises(ValueError, match="cannot set WRITEABLE"):
        line.points.setflags(write=True)
