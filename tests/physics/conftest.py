"""Drivers for tests of the simulation."""

import pytest

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.interface import Control, Observation


class Cruiser(Follower):
    """Goes on at 6 m/s, whatever happens."""

    def target_speed(self, seen: Observation) -> float:
        return 6.0


class Stander:
    """Stands on the brake."""

    def control(self, seen: Observation) -> Control:
        return Control(0.0, 1.0, 0.0)


@pytest.fixture
def cruiser() -> type[Cruiser]:
    return Cruiser


@pytest.fixture
def stander() -> type[Stander]:
    return Stander
