"""Subjects among traffic: how many classes there are, and what a selection runs of them."""

from itertools import product

import pytest

from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.junction import JunctionControl
from pytest_rvads.scenarios.classes import classes, count_scenarios, rotate, seats
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection

C = {n: grid("C", n, JunctionControl.STOP) for n in (3, 4, 5)}


@pytest.mark.parametrize("ways", [3, 4, 5])
def test_seats_of_classes_are_the_orbits_of_scenario_and_seat(ways: int) -> None:
    """Counted by brute force: pairs (scenario, seat) up to rotation."""
    everything = product(product(range(1, ways), repeat=ways), range(ways))
    orbits = {min((rotate(code, r), (seat + r) % ways) for r in range(ways)) for code, seat in everything}
    chosen = {(code, seat) for code in classes(ways) for seat in seats(code)}
    assert len(chosen) == len(orbits) == count_scenarios(ways)
    assert {min((rotate(code, r), (seat + r) % ways) for r in range(ways)) for code, seat in chosen} == orbits


def test_81_classes_in_an_x_and_8_in_a_t() -> None:
    """The numbers of the issue: 81 scenarios x 4 seats / 4 rotations, 8 x 3 / 3."""
    assert (count_scenarios(4), count_scenarios(3)) == (81, 8)
    for ways in (3, 4):
        chosen = list(Selection.of("stop4" if ways == 4 else "stop3", None, ways, C[ways], subject="all"))
        assert len(chosen) == count_scenarios(ways)
        assert {s.rotation for s in chosen} == {0}
    assert seats((1, 1, 1, 1)) == (0,)
    assert seats((1, 2, 1, 2)) == (0, 1)
    assert seats((1, 0, 0, 2)) == (0, 3), "nobody sits at an empty entrance"


@pytest.mark.parametrize("subject", [0, 2, "all"])
@pytest.mark.parametrize("cover", ["class", "scenario", "rotation"])
@pytest.mark.parametrize("numbers", [None, (1, 7, 8)])
def test_count_is_what_is_listed(subject: int | str, cover: str, numbers: tuple[int, ...] | None) -> None:
    selection = Selection.of("stop4", None, 4, C[4], classes=numbers, cover=cover, subject=subject)
    listed = list(selection)
    assert selection.count() == len(listed) == len(set(listed))
    if subject != "all":
        assert {s.subject for s in listed} == {subject}


def test_a_fixed_seat_sees_every_class_once() -> None:
    chosen = list(Selection.of("stop4", None, 4, C[4], subject=2))
    assert len({rotate(s.placed, -2) for s in chosen}) == len(chosen) == 81


def test_a_named_scenario_stays_as_named() -> None:
    (one,) = Selection.of("stop4", None, 4, C[4], scenarios=("3113",), subject=1)
    assert (one.placed, one.subject) == ((3, 1, 1, 3), 1)
    assert one.name == "stop4-class07-as3113-s1-cfgC"
    assert [s.subject for s in Selection.of("stop4", None, 4, C[4], scenarios=("3113",), subject="all")] == [0, 1, 2, 3]


@pytest.mark.parametrize("subject", [4, -1, "0", "every", True, 1.0])
def test_seats_that_are_none_are_refused(subject: object) -> None:
    with pytest.raises(ScenarioError, match="subject must be an entrance, 0 to 3, or 'all'"):
        Selection.of("stop4", None, 4, C[4], subject=subject)  # type: ignore[arg-type]
