"""Plans: every case once, counted without being listed, what does not fit left out with its reason."""

from collections import Counter
from dataclasses import replace
from typing import Any

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.geometry.finder import Choice, find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.satellites.campaigns.town import Plan, Request, Town

REQUEST = Request(Reference)


def shortened(place: Junction, entrance: int, length: float) -> Junction:
    """A junction of which one approach begins `length` metres before its entrance."""
    lanes = list(place.entrances)
    approach = lanes[entrance].approach
    assert approach is not None
    lanes[entrance] = replace(lanes[entrance], approach=approach.tail(length))
    return replace(place, name=f"{place.name.removesuffix('_short')}_short", entrances=tuple(lanes))


def test_conflicts_of_a_t_with_lights_take_three_scenarios_in_five_configurations() -> None:
    plan = Plan([find("light3")], REQUEST)
    names = [planned.name for planned in plan]
    assert len(names) == len({*names}) == plan.counts()["light3"] == 15
    assert {name[-1] for name in names} == set("FGHIJ")


def test_subject_arrives_at_every_seat_in_one_order_after_the_other_and_alone_in_as_few_runs() -> None:
    places = [find("light3"), find("stop4")]
    plan = Plan(places, replace(REQUEST, subject="all"))
    assert plan.counts() == {"light3": 9 + 6, "stop4": 32 + 12}, "without a subject there are 15 and 40"
    alone = [p.case.scenario for p in plan if sum(map(bool, p.case.scenario.placed)) == 1]
    assert {(s.place.name, s.placed.index(max(s.placed)), s.configuration) for s in alone} == {
        *(("light3", entrance, "H") for entrance in range(3)),
        *(("stop4", entrance, "C") for entrance in range(4)),
    }
    assert all(scenario.placed[scenario.subject or 0] for scenario in alone)
    assert len(alone) == 6 + 12 == len({scenario.name for scenario in alone})
    together = Counter(p.case.scenario.configuration for p in plan if p.case.scenario not in alone)
    assert {*together} == {"H", "S31", "S42", "S53", "S64", "C", "S21", "S46", "S26_56_56", "S56_56_26"}
    assert {together[name] for name in ("H", "S31", "S42", "S53", "S64")} == {1, 2}, "9 runs in 5 configurations"
    assert {together[name] for name in ("C", "S21", "S46", "S26_56_56", "S56_56_26")} == {6, 7}, "32 runs in 5"


def test_named_grid_runs_as_a_whole_at_every_seat() -> None:
    plan = Plan([find("light3")], replace(REQUEST, subject=1, grid=("staggered",)))
    together = [p.case.scenario.configuration for p in plan if all(p.case.scenario.placed)]
    assert Counter(together) == dict.fromkeys(("S31", "S42", "S53", "S64", "S75"), 3)


def test_counting_and_going_through_agree_at_every_junction() -> None:
    places = [find("stop4"), shortened(find("stop3"), 1, 25.0), shortened(find("light3"), 0, 5.0), find("lanes4")]
    for request in (
        replace(REQUEST, grid=("AC",)),
        replace(REQUEST, subject="all"),
        replace(REQUEST, subject=2, grid=("arrivals",)),
    ):
        plan = Plan(places, request)
        listed = Counter(planned.case.scenario.place.name for planned in plan)
        assert plan.counts() == {place.name: listed[place.name] for place in places}


def test_who_has_no_room_is_left_out_and_told() -> None:
    plan = Plan([shortened(find("light3"), 0, 5.0)], replace(REQUEST, grid=("GH",)))
    left_out = plan.left_out(plan.junctions[0])
    assert left_out is not None
    somebody = [p for p in Plan([find("light3")], replace(REQUEST, grid=("H",))) if p.case.scenario.placed[0]]
    assert left_out.scenarios == len(somebody)
    assert "does not fit on entrance 0" in left_out.reason
    assert not any(planned.case.scenario.configuration == "H" and planned.case.scenario.placed[0] for planned in plan)


@pytest.mark.parametrize(
    ("change", "told"),
    [({"subject": 3}, "subject must be an entrance, 0 to 2"), ({"grid": ("C",)}, "does not fit")],
)
def test_a_junction_at_which_nothing_can_run_is_refused(change: dict[str, Any], told: str) -> None:
    traffic = Policy.of("reference") if "subject" in change else None
    place = find("stop3")
    for entrance in range(3):
        place = shortened(place, entrance, 5.0)
    plan = Plan([place, find("stop4")], replace(REQUEST, traffic=traffic, **change))
    assert list(plan.refused) == ["stop3_short"]
    assert told in plan.refused["stop3_short"]
    assert plan.counts()["stop3_short"] == 0
    assert {planned.case.scenario.place.name for planned in plan} == {"stop4"}


def test_patterns_choose_by_the_id_of_a_run_and_of_a_verdict() -> None:
    every = [planned.name for planned in Plan([find("stop3"), find("stop4")], REQUEST)]
    for pattern in ("stop3-*", "*-cfgB", "stop4-class*-cfgB-no_collision", every[7], f"{every[7]}-progress"):
        found = [planned.name for planned in Plan([find("stop3"), find("stop4")], REQUEST, only=(pattern,))]
        bare = pattern.removesuffix("-no_collision").removesuffix("-progress")
        if "*" not in bare:
            assert found == [bare]
        else:
            begin, _, end = bare.partition("*")
            assert found == [name for name in every if name.startswith(begin.rstrip("*")) and name.endswith(end.split("*")[-1])]
    assert [*Plan([find("stop3")], REQUEST, only=("*-p1",))] == [], "rules that are not asked name nothing"


def test_samples_are_even_over_junctions_and_repeatable() -> None:
    places = [find("stop3"), find("stop4"), find("light4")]
    one, other = (Plan(places, REQUEST, sample=9, seed=seed) for seed in (1, 2))
    assert one.counts() == other.counts() == {"stop3": 3, "stop4": 3, "light4": 3}
    assert [p.name for p in one] == [p.name for p in Plan(places, REQUEST, sample=9, seed=1)]
    assert [p.name for p in one] != [p.name for p in other]


def test_traffic_is_named_in_ids_but_for_the_usual_one() -> None:
    for policy, ending in (("reference", "-s0-cfgA"), ("hesitant", "-s0-cfgA-hesitant")):
        request = replace(REQUEST, subject=0, traffic=Policy.of(policy), grid=("A",))
        assert all(planned.name.endswith(ending) for planned in Plan([find("stop3")], request))


def test_junctions_with_approaches_too_short_for_a_staggered_start_are_told() -> None:
    short, place = shortened(find("light3"), 0, 30.0), find("stop3")
    town = Town((), Choice((short, place), (), 0), Plan([short, place], replace(REQUEST, subject="all")))
    assert [note for note in town.notes() if "staggered" in note] == [
        "1 junction with an approach too short for a staggered start, where vehicles start as far out as they can: light3_short"
    ]
    far = [p.case.scenario for p in town.plan if p.case.scenario.configuration == "S42" and p.case.scenario.subject]
    assert {scenario.start(0) for scenario in far} == {(30.0, 8.0)}
