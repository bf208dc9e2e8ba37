"""Starts on approaches that bend: no faster than the bends ahead can be taken."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.scenarios.configurations import configuration, started

LATERAL, BRAKING = 2.5, 2.0
"""What the reference takes bends with, and brakes with before them [m/s^2]."""


def bent(radius: float, straight: float) -> Junction:
    """Return the all-way stop with approaches that turn left by 90 degrees, and lead straight on up to the entrance vertex."""
    angle = np.arange(0.0, math.pi / 2.0, 0.01)[:, None]
    arc = radius * np.hstack((np.sin(angle), 1.0 - np.cos(angle)))
    approach = Segment("bent", np.vstack(([-60.0, 0.0], arc, [radius, radius], [radius, radius + straight])))
    place = find("stop4")
    return replace(place, entrances=tuple(replace(lane, approach=approach) for lane in place.entrances))


def speeds(place: Junction, label: str, subject: int | None = None, followers: int = 0) -> tuple[float, ...]:
    start: tuple[float, ...] = started(configuration(label, 4), place, 0, subject, followers)["speed"]
    return start


def test_a_start_in_a_bend_is_as_slow_as_the_bend_is_taken() -> None:
    place = bent(10.0, 14.0 - find("stop4").setbacks[0])  # D starts 20 m before the line, 6 m before the end of the bend
    assert speeds(place, "D") == pytest.approx((math.sqrt(LATERAL * 10.0),) * 4, rel=0.02)


def test_a_start_before_a_bend_leaves_room_to_brake() -> None:
    arc = 4.0 * math.pi / 2.0
    place = bent(4.0, 20.0 - 8.0 - arc - find("stop4").setbacks[0])  # D starts 8 m before the bend
    exact = math.sqrt(LATERAL * 4.0 + 2.0 * BRAKING * 8.0)  # bends are measured over 4 m, so that they begin 2 m later
    assert speeds(place, "D") == pytest.approx((exact,) * 4, rel=0.1)


def test_a_start_behind_a_bend_is_as_fast_as_asked() -> None:
    place = bent(4.0, 60.0)
    assert speeds(place, "D") == (10.0,) * 4
    assert speeds(place, "S21", 0) == (8.0,) * 4, "the subject starts 36 m before the line"


def test_a_queue_that_reaches_into_a_bend_starts_as_slowly_as_its_last_vehicle_must() -> None:
    place = bent(10.0, 32.0)
    assert speeds(place, "D") == (10.0,) * 4
    assert speeds(place, "D", followers=1) == pytest.approx((math.sqrt(LATERAL * 10.0),) * 4, rel=0.02)


@pytest.mark.parametrize("name", [name for name in names() if name != "roundabout4"])  # its ring is an approach that bends
def test_straight_approaches_slow_nobody(name: str) -> None:
    place = find(name)
    point = configuration("D", len(place.entrances))
    assert started(point, place, 0, None, 0)["speed"] == point.speeds
