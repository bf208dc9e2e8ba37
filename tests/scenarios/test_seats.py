"""Subjects among traffic: how many classes there are, and what a selection runs of them."""

from itertools import product
from typing import Any

import pytest

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find
from pytest_rvads.scenarios.classes import Orbits, classes, count_scenarios, rotate
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.support.errors import ScenarioError

PLACES = {3: find("stop3"), 4: find("stop4")}
C = {n: grid("C", n, JunctionControl.STOP) for n in PLACES}


@pytest.mark.parametrize("ways", [3, 4, 5])
def test_seats_of_classes_are_the_orbits_of_scenario_and_seat(ways: int) -> None:
    """Counted by brute force: pairs (scenario, seat) up to rotation."""
    everything = product(product(range(1, ways), repeat=ways), range(ways))
    orbits = {min((rotate(code, r), (seat + r) % ways) for r in range(ways)) for code, seat in everything}
    chosen = {(code, seat) for code in classes(ways) for seat in Orbits.plain(ways).seats(code)}
    assert len(chosen) == len(orbits) == count_scenarios(ways)
    assert {min((rotate(code, r), (seat + r) % ways) for r in range(ways)) for code, seat in chosen} == orbits


def test_81_classes_in_an_x_and_8_in_a_t() -> None:
    """The numbers of the issue: 81 scenarios x 4 seats / 4 rotations, 8 x 3 / 3."""
    assert (count_scenarios(4), count_scenarios(3)) == (81, 8)
    for ways in (3, 4):
        chosen = list(Selection(PLACES[ways], C[ways], subject="all"))
        assert len(chosen) == count_scenarios(ways)
        assert {s.rotation for s in chosen} == {0}
    seats = Orbits.plain(4).seats
    assert seats((1, 1, 1, 1)) == (0,)
    assert seats((1, 2, 1, 2)) == (0, 1)
    assert seats((1, 0, 0, 2)) == (0, 3), "nobody sits at an empty entrance"


@pytest.mark.parametrize("subject", [0, 2, "all"])
@pytest.mark.parametrize("cover", ["class", "scenario", "rotation"])
@pytest.mark.parametrize("numbers", [None, (1, 7, 8)])
def test_count_of_seats_equals_the_length_of_the_selection(
    subject: int | str, cover: str, numbers: tuple[int, ...] | None
) -> None:
    selection = Selection(PLACES[4], C[4], classes=numbers, cover=cover, subject=subject)
    listed = list(selection)
    assert selection.count() == len(listed) == len(set(listed))
    if subject != "all":
        assert {s.subject for s in listed} == {subject}


def test_a_fixed_seat_sees_every_class_once() -> None:
    chosen = list(Selection(PLACES[4], C[4], subject=2))
    assert len({rotate(s.placed, -2) for s in chosen}) == len(chosen) == 81


def test_a_named_scenario_stays_as_named() -> None:
    (one,) = Selection(PLACES[4], C[4], scenarios=((3, 1, 1, 3),), subject=1)
    assert (one.placed, one.subject) == ((3, 1, 1, 3), 1)
    assert one.name == "stop4-class07-as3113-s1-cfgC"
    assert [s.subject for s in Selection(PLACES[4], C[4], scenarios=((3, 1, 1, 3),), subject="all")] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"subject": 4}, "subject must be an entrance, 0 to 3, or 'all', got 4"),
        ({"subject": -1}, "subject must be an entrance, 0 to 3, or 'all', got -1"),
        ({"subject": "every"}, "subject must be an entrance, 0 to 3, or 'all', got 'every'"),
        ({"classes": (0,)}, "a 4-way junction has classes 1..24, got 0"),
        ({"classes": (24, 25)}, "a 4-way junction has classes 1..24, got 25"),
    ],
)
def test_missing_entrances_and_classes_are_refused(asked: dict[str, Any], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        Selection(PLACES[4], C[4], **asked)
