"""Abstract scenarios and their classes, against the definitions of the paper."""

from itertools import product
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.finder import find
from pytest_rvads.scenarios.classes import (
    Orbits,
    classes,
    count_classes,
    count_scenarios,
    parse,
    rotate,
)
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.support.errors import ScenarioError

codes = st.integers(3, 8).flatmap(lambda n: st.tuples(*[st.integers(1, n - 1)] * n))


@pytest.mark.parametrize(
    ("ways", "scenarios", "number"),
    [(3, 8, 4), (4, 81, 24), (5, 1024, 208), (8, 5_764_801, 720_916)],
)
def test_counts_are_those_published(ways: int, scenarios: int, number: int) -> None:
    assert (count_scenarios(ways), count_classes(ways)) == (scenarios, number)


@pytest.mark.parametrize("ways", [3, 4, 5, 6])
def test_classes_partition_the_scenarios(ways: int) -> None:
    everything = set(product(range(1, ways), repeat=ways))
    seen = [member for first in classes(ways) for member in Orbits.plain(ways).members(first)]
    assert len(seen) == len(everything) == count_scenarios(ways)
    assert set(seen) == everything


def test_listing_yields_as_many_classes_as_burnside_counts() -> None:
    assert [sum(1 for _ in classes(n)) for n in (3, 4, 5, 6, 7)] == [count_classes(n) for n in (3, 4, 5, 6, 7)]


def test_classes_of_the_paper_have_their_numbers() -> None:
    # Classes 1 to 4 of the paper begin with these rows; their numbers here follow the order in `scenarios/ids.py`.
    rows = ("2111", "3111", "1233", "2121")
    assert [Orbits.plain(4).number(parse(row)) for row in rows] == [2, 3, 13, 8]
    assert Orbits.plain(4).number(parse("1133")) == 7
    assert Orbits.plain(4).number(parse("3333")) == 24


@given(codes, st.integers(-20, 20))
@settings(derandomize=True, deadline=None)
def test_every_rotation_is_in_the_same_class(code: tuple[int, ...], rows: int) -> None:
    orbits = Orbits.plain(len(code))
    assert orbits.number(rotate(code, rows)) == orbits.number(code)
    assert orbits.representative(rotate(code, rows)) == orbits.representative(code)
    assert rotate(code, rows) in orbits.members(code)


@given(codes)
@settings(derandomize=True, deadline=None)
def test_rotation_moves_vehicles_and_keeps_their_directions(code: tuple[int, ...]) -> None:
    for row, placed in enumerate(Orbits.plain(len(code)).turns(code)):
        assert all(placed[(i + row) % len(code)] == code[i] for i in range(len(code)))


def test_numbers_follow_the_order_of_the_representatives() -> None:
    assert [Orbits.plain(5).number(code) for code in classes(5)] == list(range(1, 209))
    assert Orbits.plain(8).number((7,) * 8) == count_classes(8)


def test_partial_scenarios_have_class_0() -> None:
    assert Orbits.plain(4).number(parse("1020")) == 0


@pytest.mark.parametrize(
    ("directions", "says"),
    [
        ("0000", "at least one vehicle"),
        ("1-11", "must be digits"),
        ("", "must be digits"),
        ("__", "must be digits"),
        ((1, 1, -1, 1), "a number from 1 to 35, or 0 for nobody"),
        (None, "must be digits, one per entrance, such as '1133', got None"),
        ((1.0, 1, 1, 1), "must be digits"),
    ],
)
def test_wrong_directions_say_what_is_expected(directions: Any, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        parse(directions)


@pytest.mark.parametrize(
    ("directions", "says"),
    [
        ("11", "'11' describe 2 entrances, junction 'stop4' has 4"),
        ("1144", "direction 4 is none of entrance 2 .* lead into 1, 2, 3, and 0 is nobody, got '1144'"),
        ("1a11", "direction 10 is none of entrance 1 of junction 'stop4'"),
    ],
)
def test_missing_movements_are_refused_with_the_existing_movements(directions: str, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        Scenario(find("stop4"), directions)


@pytest.mark.parametrize("ways", [2, 9, 0, -1])
def test_other_arities_are_refused(ways: int) -> None:
    with pytest.raises(ScenarioError, match="3 to 8"):
        count_classes(ways)
