"""Abstract scenarios and their classes, against the paper's definitions and against orbits found by turning every scenario."""

import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Key, Movement
from pytest_rvads.scenarios.classes import (
    OCCUPANCIES,
    Directions,
    Orbits,
    classes,
    count_classes,
    count_scenarios,
    covering,
    pairs_at,
    parse,
    rotate,
)
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.scenario import Scenario, usual_duration
from pytest_rvads.scenarios.selection import COVERS, Selection
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


def junction(lanes: list[list[tuple[int, ...]]], signs: str = "", phases: tuple[int, ...] = ()) -> Junction:
    """A junction without geometry: per arm its entrances, each with the arms further on that movements lead to."""
    kinds = {"s": Sign.STOP, "y": Sign.YIELD, "p": Sign.PRIORITY, "l": Sign.LIGHTS}
    places = [(arm, lane) for arm, found in enumerate(lanes) for lane in range(len(found))]
    entrances = tuple(
        Entrance(arm, lane, kinds[(signs or "s" * len(lanes))[arm]], phases[number] if phases else None)
        for number, (arm, lane) in enumerate(places)
    )
    keys = [(e, (arm + j) % len(lanes)) for e, (arm, lane) in enumerate(places) for j in lanes[arm][lane]]
    movements: dict[Key, Movement] = {key: Movement(*key, Turn.STRAIGHT, 10.0, "m") for key in keys}
    exits = tuple(Exit(arm) for arm in range(len(lanes)))
    return Junction("made", "1", entrances, exits, movements, frozenset(), frozenset())


TURN_LANES = junction([[(1, 2), (3,)]] * 4)
"""Four arms with a lane for right and straight, and one for left."""
TWICE = junction([[(1, 2), (3,)], [(1,)]] * 2)
"""Turned by two arms it is the same."""
ONE_WAY = junction([[(1,), (2,)], [], [(1, 2)]])
"""One arm leads out only, and no rotation keeps it."""
PLACES = {"turn lanes": TURN_LANES, "twice": TWICE, "one-way": ONE_WAY, "stop3": find("stop3"), "stop4": find("stop4")}


def everything(place: Junction, occupancy: str, partial: bool) -> list[Directions]:
    """All scenarios, by the definition: everything that could stand there, and what of it is full."""
    codes = product(*((0, *place.directions(e)) for e in range(len(place.entrances))))

    def fits(code: Directions) -> bool:
        counts = [sum(code[e] > 0 for e in arm.entrances) for arm in place.arms]
        most = [min(1, len(arm.entrances)) if occupancy == "arms" else len(arm.entrances) for arm in place.arms]
        return any(code) and (all(map(int.__le__, counts, most)) if partial else counts == most)

    return [code for code in codes if fits(code)]


@pytest.mark.parametrize("partial", [False, True])
@pytest.mark.parametrize("occupancy", OCCUPANCIES)
@pytest.mark.parametrize("name", PLACES)
def test_classes_are_the_orbits_in_the_order_of_their_least_members(name: str, occupancy: str, partial: bool) -> None:
    place = PLACES[name]
    orbits, codes = Orbits.at(place, occupancy, partial=partial), everything(PLACES[name], occupancy, partial)
    images = [(image := place.image(arms)) and image[0] for arms in place.rotations]
    least = sorted(
        {min(tuple(code[images_.index(e)] for e in range(len(code))) for images_ in images if images_) for code in codes}
    )
    assert list(orbits) == least
    assert (orbits.scenarios, orbits.count) == (len(codes), len(least))
    assert [orbits.number(code) for code in least] == list(range(1, len(least) + 1))
    assert {orbits.number(turned) for code in least[:1] for turned in orbits.turns(code)} == {1}


def test_counts_of_small_junctions_by_hand() -> None:
    """Three movements on each of four arms: as in the paper, and 69 with empty arms: (256 + 16 + 4 + 4) / 4 - 1."""
    assert (Orbits.at(TURN_LANES).scenarios, Orbits.at(TURN_LANES).count) == (81, 24)
    assert Orbits.at(find("stop4"), partial=True).count == Orbits.at(TURN_LANES, partial=True).count == 69
    assert Orbits.at(TURN_LANES, "lanes").count == 6, "necklaces of four beads in two colours"
    assert (Orbits.at(ONE_WAY).count, Orbits.at(ONE_WAY, "lanes").count) == (4, 2), "nothing is turned: 2 x 2, and 1 x 1 x 2"
    assert Orbits.at(find("stop4")) == Orbits.plain(4)


def test_signs_that_differ_leave_fewer_rotations() -> None:
    """A major road: only half a turn keeps the signs, so that 81 scenarios have (81 + 9) / 2 classes."""
    major = junction([[(1, 2, 3)]] * 4, "pypy")
    assert list(Orbits.at(major).rows) == [0, 2]
    assert Orbits.at(major).count == 45
    assert Scenario(major, "1133", rotation=2).number == Scenario(major, "3311").number
    with pytest.raises(ScenarioError, match="rotation must be one of 0, 2, by so many entrances junction 'made' keeps"):
        Scenario(major, "1133", rotation=1)


blocks = st.lists(
    st.lists(st.sampled_from([(), (1,), (2,), (1, 2)]), min_size=1, max_size=2).filter(lambda lanes: any(lanes)),
    min_size=1,
    max_size=2,
)


@pytest.mark.extended
@given(blocks, st.integers(1, 5), st.booleans())
@settings(derandomize=True, deadline=None, max_examples=60)
def test_numbers_of_any_word_are_places_in_the_list(block: list[list[tuple[int, ...]]], times: int, partial: bool) -> None:
    slots = tuple(
        tuple(sorted({tuple(d if k == lane else 0 for k in range(len(arm))) for lane, ds in enumerate(arm) for d in ds} | nobody))
        for arm in block
        for nobody in [{(0,) * len(arm)} if partial else set()]
    )
    orbits = Orbits(slots * times, times, partial)
    if orbits.scenarios > 2000:
        return
    codes = [code for letters in product(*orbits.slots) if any(code := sum(letters, ()))]
    least = sorted({orbits.representative(code) for code in codes})
    assert list(orbits) == least
    assert len(least) == orbits.count
    places = {code: number for number, code in enumerate(least, start=1)}
    assert all(orbits.number(code) == places[orbits.representative(code)] for code in codes)
    for entrance in range(orbits.size):
        assert orbits.seated(entrance) == sum(code[entrance] > 0 for code in codes)
        assert orbits.turned(entrance) == sum(turned[entrance] > 0 for code in least for turned in orbits.turns(code))


def test_twelve_entrance_lanes_are_counted_and_numbered_at_once() -> None:
    """4 arms x 3 lanes x 3 movements: 3^12 scenarios, (3^12 + 3^6 + 2 x 3^3) / 4 classes; the last one is all threes."""
    place = junction([[(1, 2, 3)] * 3] * 4)
    start = time.process_time()
    orbits = Orbits.at(place, "lanes")
    assert orbits.count == (3**12 + 3**6 + 2 * 3**3) // 4
    assert orbits.number((3,) * 12) == orbits.count
    assert Scenario(place, (3,) * 12).name == "made-class133056-as333_333_333_333-cfgd20.00v00.00"
    assert time.process_time() - start < 1


def test_numbers_alone_are_those_of_occupied_arms() -> None:
    arms, lanes, partial = (Scenario(TURN_LANES, code) for code in ("10_03_20_10", "13_23_13_13", "10_00_20_00"))
    assert [s.number for s in (arms, lanes, partial)] == [Orbits.at(TURN_LANES).number(arms.directions), 2, 0]
    assert [s.orbit for s in (arms, lanes, partial)] == ["", "13_13_13_23", "00_10_00_20"]
    assert [s.name.split("-")[1:3] for s in (lanes, partial)] == [["class02", "as13_23_13_13"], ["class00", "as10_00_20_00"]]


def test_lights_turn_with_the_lanes() -> None:
    """Left turns have a phase of their own, so that a quarter turn takes the first group to the third one."""
    place = junction([[(1, 2), (3,)]] * 4, "llll", (0, 1, 2, 3) * 2)
    groups = [(row, Scenario(place, "10_10_10_10", rotation=row).signals().first) for row in Orbits.at(place).rows]
    assert groups == [(0, 0), (2, 2), (4, 0), (6, 2)]
    assert usual_duration(place) == Scenario(place, "10_10_10_10").duration == 4 * 20 + 30
    assert usual_duration(find("light4")) == Scenario(find("light4"), "1111").duration == 60
    assert Scenario(place, "10_10_10_10", duration=5).duration == 5


@pytest.mark.parametrize("occupancy", OCCUPANCIES)
@pytest.mark.parametrize("cover", COVERS[:-1])
@pytest.mark.parametrize("subject", [None, "all", 2])
@pytest.mark.parametrize("name", ["turn lanes", "one-way", "stop4"])
def test_count_equals_the_length_of_the_selection(name: str, subject: Any, cover: str, occupancy: str) -> None:
    place = PLACES[name]
    points = grid("C", len(place.entrances), place.control)
    selection = Selection(place, points, cover=cover, occupancy=occupancy, subject=subject, followers=(0, 2))
    listed = list(selection)
    assert len(listed) == len(set(listed)) == 2 * selection.count()
    assert {s.subject is None for s in listed} == {subject is None}
    assert {s.followers for s in listed} == {0, 2}


def pairs_in(place: Junction, codes: Iterable[Directions]) -> set[tuple[tuple[int, int], ...]]:
    """The pairs of movements that meet in scenarios."""
    movements = [sorted(place.leads(e, d).key for e, d in enumerate(code) if d) for code in codes]
    return {pair for keys in movements for pair in combinations(keys, 2)}


@pytest.mark.parametrize("occupancy", OCCUPANCIES)
@pytest.mark.parametrize("place", [TURN_LANES, ONE_WAY, find("light4")], ids=["turn lanes", "one-way", "light4"])
def test_every_pair_of_movements_happens_that_can(place: Junction, occupancy: str) -> None:
    orbits = Orbits.at(place, occupancy)
    codes = covering(place, orbits)
    possible = pairs_in(place, everything(place, occupancy, False))
    assert pairs_in(place, codes) == possible
    assert all(code in orbits for code in codes)
    assert covering(place, orbits) == codes
    movements = len(place.movements)
    same = sum(len(place.directions(e)) * (len(place.directions(e)) - 1) // 2 for e in range(len(place.entrances)))
    assert len(pairs_at(place)) == movements * (movements - 1) // 2 - same
    if occupancy == "lanes":
        assert possible == set(pairs_at(place))


def test_conflicts_need_fewer_scenarios_than_pairs_and_these_fewer_than_classes() -> None:
    place = find("stop4")
    pairs, conflicts = (covering(place, Orbits.at(place), conflicting=only) for only in (False, True))
    made = pairs_in(place, conflicts)
    assert made >= {(a, b) for a, b in combinations(sorted(place.movements), 2) if (a, b) in (place.conflicts or ())}
    assert 9 <= len(pairs) <= 11, "9 is the least for two columns of three; an orthogonal array has 4 columns in 9 rows"
    assert len(conflicts) <= len(pairs)


def test_a_seat_is_taken_in_every_scenario_of_a_cover_of_pairs() -> None:
    codes = covering(TURN_LANES, Orbits.at(TURN_LANES), 1)
    assert {code[:2] for code in codes} == {(0, 3)}
    others = pairs_in(TURN_LANES, codes)
    assert {pair for pair in pairs_at(TURN_LANES) if pair[0][0] == 1 and pair[1][0] > 1} <= others


def test_what_can_not_be_covered_is_refused() -> None:
    with pytest.raises(ScenarioError, match="the conflicts of junction 'made' are not known, since"):
        covering(TURN_LANES, Orbits.at(TURN_LANES), conflicting=True)
    with pytest.raises(ScenarioError, match="occupancy must be one of arms, lanes, got 'some'"):
        Orbits.at(TURN_LANES, "some")
    with pytest.raises(ScenarioError, match="no two movements of junction 'made' happen in one scenario"):
        covering(alone := junction([[(1,)], [], []]), Orbits.at(alone))
    with pytest.raises(ScenarioError, match="junction 'made' has no movements, so nobody can be placed there"):
        Orbits.at(replace(alone, movements={}))
    points = grid("C", 4, find("stop4").control)
    with pytest.raises(ScenarioError, match="cover='pairs' chooses scenarios itself"):
        Selection(find("stop4"), points, cover="pairs", classes=(1,))
    with pytest.raises(ScenarioError, match=r"a 4-way junction has classes 1\.\.6 of occupancy='lanes', got 7"):
        Selection(TURN_LANES, points, occupancy="lanes", classes=(7,))


@pytest.mark.parametrize("row", [0, 2, 4, 6])
def test_rows_of_lanes_move_vehicles_arm_by_arm(row: int) -> None:
    scenario = Scenario(TURN_LANES, "10_03_20_10", distance=tuple(range(1, 9)), rotation=row)
    assert scenario.placed == rotate(scenario.directions, row)
    assert scenario.number == Scenario(TURN_LANES, scenario.label).number
    assert scenario.start(row) == (1.0, 0.0)
    assert [a.name for a in Scenario(TURN_LANES, "10_03_20_10", followers=1).agents()][:4] == ["a0.0", "a0.0+1", "a1.1", "a1.1+1"]
