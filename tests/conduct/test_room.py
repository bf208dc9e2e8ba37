"""The room that a vehicle before its line leaves for the bodies of vehicles on other movements."""

import math
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find, names
from pytest_rvads.logic.conduct.bodies import touch
from pytest_rvads.logic.conduct.room import PLACES, leaves_room, room
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.states import Vehicle

CAR = (Vehicle().length, Vehicle().width)


@pytest.mark.parametrize("name", names())
def test_vehicle_at_the_line_of_a_built_in_junction_leaves_room_for_every_movement(name: str) -> None:
    assert room(find(name)) == {}


def test_vehicle_at_a_line_in_a_narrow_lane_is_touched_by_bodies_on_the_centre_line(shared: Path) -> None:
    """The lanes are 2.3 to 2.7 m wide, and a body that turns into the opposite lane sweeps more than that."""
    junction = find("j_1676908212", shared / "maps" / "durlacher-tor.xodr")
    table = room(junction)
    assert table
    touched = 0
    for (entrance, key), places in table.items():
        assert places.shape == PLACES.shape
        own = next(movement for movement in junction.movements if movement[0] == entrance)
        standing = itinerary(junction, *own)
        moving = itinerary(junction, *key)
        poses = np.array([moving.pose(station) for station in np.arange(0.0, moving.length + 6.0, 0.25)])
        car = np.repeat([standing.pose(standing.line)], len(poses), axis=0)
        touched += bool(touch([(poses, CAR), (car, CAR)]).any())
        back = leaves_room(junction, entrance, key)
        assert back == math.inf or not places[PLACES.tolist().index(back)]
    assert touched, "without a planned path some body touches a car that stands at its line"
