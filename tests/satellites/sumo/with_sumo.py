"""Marks and helpers of tests that need SUMO."""

from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.satellites.sumo.road_network import program_and_home
from pytest_rvads.support.errors import RunError


def installed() -> bool:
    """Return whether libsumo and netconvert are installed."""
    try:
        program_and_home()
    except RunError:
        return False
    return find_spec("libsumo") is not None


needs_sumo = pytest.mark.skipif(not installed(), reason="pip install 'pytest-rvads[sumo]'")


def simulated(junction: str | rvads.Junction, directions: Any, simulator: rvads.Sumo = rvads.sumo, **more: Any) -> rvads.Run:
    """Return a run in which SUMO drives every vehicle, by default from 20 m before the line at 10 m/s."""
    place = rvads.find(junction) if isinstance(junction, str) else junction
    scenario = rvads.Scenario(place, directions, **{"distance": 20.0, "speed": 10.0, **more})
    return rvads.simulate(rvads.Case(scenario, rvads.traffic("sumo")), simulator)


def signed(base: str, *signs: rvads.values.Sign, **more: Any) -> rvads.Junction:
    """Return a built-in junction with other signs."""
    place = rvads.find(base)
    lanes = tuple(replace(lane, sign=sign, phase=None) for lane, sign in zip(place.entrances, signs, strict=True))
    return replace(place, name="signed", entrances=lanes, **more)
