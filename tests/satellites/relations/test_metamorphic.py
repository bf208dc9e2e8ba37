"""Metamorphic relations: what is equivalent by construction must be judged alike, and faults that break it are found."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.satellites.relations.metamorphic import compare, equivalent
from pytest_rvads.satellites.relations.variants import RELATIONS, Incomparable, Variant, broken_by, mirrored, moved, rotations_of
from pytest_rvads.scenarios.case import Case

NONE: dict[str, Any] = {"i1": False, "i2": False, "i3": False, "i4": False, "i5": False}


def lgsvl(*deficiencies: str) -> partial[rvads.LgsvlLike]:
    return partial(rvads.LgsvlLike, **(NONE | dict.fromkeys(deficiencies, True)))


@pytest.mark.parametrize("name", ["stop4", "light4", "paper_stop4", "paper_light4"])
def test_x_junction_has_four_symmetries(name: str) -> None:
    assert [(s.arms, s.rows) for s in rotations_of(rvads.find(name))] == [(r, r) for r in range(4)]


@pytest.mark.parametrize("name", ["stop3", "light3"])
def test_t_junction_has_only_the_identity(name: str) -> None:
    junction = rvads.find(name)
    assert [s.rows for s in rotations_of(junction)] == [0]
    assert "opposite" in broken_by(junction, 1)  # a single pair of arms is opposite
    variants = list(RELATIONS["rotation"](Case(rvads.Scenario(rvads.find(name), "112"), rvads.Reference)))
    assert len(variants) == 2
    assert all(isinstance(item, Incomparable) for item in variants)


def test_rotation_finds_the_hidden_zone() -> None:
    with pytest.raises(rvads.errors.MetamorphicViolation, match="turns p1 from PASS into FAIL") as caught:
        equivalent(Case(rvads.Scenario(rvads.find("paper_stop4"), "1010"), lgsvl("i2")))
    (note,) = caught.value.__notes__
    assert "a0 0->1: arrives" in note
    assert "a1 1->2: arrives" in note  # the corresponding vehicle of the rotated scenario
    assert "p1" in note


def test_order_of_creation_finds_ignored_ties() -> None:
    with pytest.raises(rvads.errors.MetamorphicViolation, match=r"p2 from (PASS into FAIL|FAIL into PASS)"):
        equivalent(Case(rvads.Scenario(rvads.find("paper_stop4"), "2200"), lgsvl("i3")), relations="creation")
    equivalent(Case(rvads.Scenario(rvads.find("paper_stop4"), "2200"), lgsvl()), relations="creation")


def test_longer_approaches_find_the_launch() -> None:
    with pytest.raises(rvads.errors.MetamorphicViolation, match="approach longer by 20 m turns p1 from FAIL into PASS"):
        equivalent(Case(rvads.Scenario(rvads.find("stop4"), "2020", distance=0.01), lgsvl("i1")), relations="approach")
    equivalent(Case(rvads.Scenario(rvads.find("stop4"), "2020", distance=0.01), lgsvl()), relations="approach")


@pytest.mark.extended
@pytest.mark.parametrize(
    ("junction", "directions", "compared"),
    [("stop4", "1230", 8), ("stop3", "120", 5), ("light4", "2302", 6), ("light3", "210", 3)],
)
def test_reference_survives_all_relations(junction: str, directions: str, compared: int) -> None:
    comparison = compare(Case(rvads.Scenario(rvads.find(junction), directions), rvads.Reference), relations=tuple(RELATIONS))
    assert not comparison.differences
    assert len(comparison.compared) == compared


def test_renaming_finds_a_pilot_that_decides_by_names() -> None:
    class Vain(rvads.Reference):
        """Does not see vehicles with names before its own name in the alphabet."""

        def control(self, seen: Observation) -> Control:
            others = tuple(o for o in seen.others if o.name > seen.me.name)
            return super().control(seen._replace(others=others))

    comparison = compare(Case(rvads.Scenario(rvads.find("stop4"), "2200"), Vain), relations="renaming")
    assert {d.one.rule for d in comparison.differences} == {"p2"}


def test_motion_finds_a_pilot_that_decides_by_coordinates() -> None:
    class Homesick(rvads.Reference):
        """Ignores all other vehicles far away from the origin of the map."""

        def control(self, seen: Observation) -> Control:
            far = abs(seen.me.x) + abs(seen.me.y) > 60
            return super().control(seen._replace(others=()) if far else seen)

    comparison = compare(Case(rvads.Scenario(rvads.find("stop4"), "2020"), Homesick), relations="motion")
    assert "p1" in {d.one.rule for d in comparison.differences}


def test_moved_and_mirrored_maps_have_the_same_junction() -> None:
    scenario = rvads.Scenario(rvads.find("light3"), "121")
    before = scenario.place
    after = moved(before, (10.0, 20.0, 0.5))
    assert {k: round(m.length, 6) for k, m in after.movements.items()} == {
        k: round(m.length, 6) for k, m in before.movements.items()
    }
    assert (after.right_of, after.opposite, after.phase_groups) == (before.right_of, before.opposite, before.phase_groups)
    mirror = mirrored(before)
    assert mirror.left_hand
    assert sorted(round(m.length, 6) for m in mirror.movements.values()) == sorted(
        round(m.length, 6) for m in before.movements.values()
    )
    (variant,) = RELATIONS["mirror"](Case(scenario, rvads.Reference))
    assert isinstance(variant, Variant)
    mirrored_turn = {
        rvads.values.Turn.LEFT: rvads.values.Turn.RIGHT,
        rvads.values.Turn.RIGHT: rvads.values.Turn.LEFT,
        rvads.values.Turn.STRAIGHT: rvads.values.Turn.STRAIGHT,
    }
    by_entrance = {agent.entrance: agent for agent in variant.case.agents()}
    for agent in scenario.agents():
        assert by_entrance[variant.image[agent.entrance]].turn is mirrored_turn[agent.turn]
    assert {(variant.image[a], variant.image[b]) for a, b in before.right_of} == set(mirror.right_of)


def test_vehicles_on_a_moved_map_start_at_corresponding_places() -> None:
    scenario = rvads.Scenario(rvads.find("light4"), "1203", distance=(5, 10, 15, 20), rotation=1)
    case = Case(scenario, rvads.Reference)
    (variant,) = RELATIONS["motion"](case)
    assert isinstance(variant, Variant)
    run, moved_run = rvads.simulate(case), rvads.simulate(variant.case)
    columns = [[a.entrance for a in moved_run.agents].index(variant.image[a.entrance]) for a in run.agents]
    assert np.allclose(run.station[0], moved_run.station[0][columns])
    assert (run.lights[0] == moved_run.lights[0][list(variant.image)]).all()


@pytest.mark.parametrize(("junction", "directions", "rotations"), [("zebra4", "2010", 1), ("walk4", "2030", 3)])
@pytest.mark.parametrize("behaviour", ["group", "hidden"])
def test_pedestrians_walk_at_corresponding_crosswalks(junction: str, directions: str, rotations: int, behaviour: str) -> None:
    walkers = [rvads.Pedestrian(0, behaviour=behaviour), rvads.Pedestrian(2, side="far", difference=1.5)]
    case = Case(
        rvads.Scenario(rvads.find(junction), directions, distance=25, speed=8, subject=0, pedestrians=walkers), rvads.Reference
    )
    variants = [v for name in RELATIONS for v in RELATIONS[name](case) if isinstance(v, Variant)]
    assert sum(variant.what.startswith("rotation") for variant in variants) == rotations
    starts = {setting.agent.name: setting[1:] for setting in case.scenario.walkers()}
    for variant in variants:
        if not variant.what.startswith("approach"):
            moved_starts = {setting.agent.name: setting[1:] for setting in variant.case.scenario.walkers()}
            assert moved_starts.keys() == starts.keys()
            for name, numbers in starts.items():
                assert moved_starts[name] == pytest.approx(numbers, abs=1e-3), (variant.what, name)
    rotated = next(variant for variant in variants if variant.what == "rotation by 2")
    assert [walker.crossing for walker in rotated.case.scenario.pedestrians] == [2, 0]


def test_pedestrian_who_would_meet_another_vehicle_first_is_incomparable() -> None:
    walkers = [rvads.Pedestrian(2, side="far")]  # both vehicles drive over the crosswalk of arm 2
    scenario = rvads.Scenario(rvads.find("walk4"), "2030", distance=(25, 25, 15, 25), speed=8, pedestrians=walkers)
    answers = {item.what: item for item in RELATIONS["rotation"](Case(scenario, rvads.Reference))}
    assert isinstance(answers["rotation by 1"], Variant)
    assert isinstance(answers["rotation by 2"], Incomparable)
    assert "would meet another vehicle first" in answers["rotation by 2"].why


class BlindElsewhere(rvads.Reference):
    """Keeps its speed whatever happens, unless it comes from entrance 0."""

    def control(self, seen: Observation, /) -> Any:
        return super().control(seen) if seen.me.entrance == 0 else rvads.TargetSpeed(8.0)


def test_table_of_two_runs_has_the_pedestrians() -> None:
    scenario = rvads.Scenario(rvads.find("zebra4"), "2000", distance=25, speed=8, pedestrians=[rvads.Pedestrian(0)])
    with pytest.raises(rvads.errors.MetamorphicViolation, match="rotation by 2 turns no_collision from PASS into FAIL") as caught:
        equivalent(Case(scenario, BlindElsewhere), "no_collision")
    lines = [line.split() for line in caught.value.__notes__[0].splitlines()]
    assert [line[:2] for line in lines[3:5]] == [["vehicle", "a0"], ["pedestrian", "p0"]]
    assert [line.count("p0") for line in lines[3:5]] == [0, 2]


def test_rotation_that_moves_crosswalks_to_other_places_is_incomparable() -> None:
    place = rvads.find("walk4")
    without = replace(place, crossings=place.crossings[:1])
    case = Case(rvads.Scenario(without, "2030", pedestrians=[rvads.Pedestrian(0)]), rvads.Reference)
    assert [item.why for item in RELATIONS["rotation"](case) if isinstance(item, Incomparable)] == [
        "walk4 has other crosswalks there"
    ] * 3


def test_corners_of_a_crosswalk_are_mirrored(tmp_path: Path) -> None:
    path = tmp_path / "skew.xodr"
    text = path_of("zebra4").read_text(encoding="utf-8")
    path.write_text(text.replace('u="-1.5" v="-4"', 'u="-1.5" v="-2"'), encoding="utf-8")
    place = rvads.find("1", path)
    areas = [{tuple(point) for point in crosswalk.area.round(6).tolist()} for crosswalk in place.crossings]
    mirrored_areas = [{tuple(point) for point in c.area.round(6).tolist()} for c in mirrored(place).crossings]
    assert all({(x, -y + 0.0) for x, y in area} in mirrored_areas for area in areas)


def test_order_of_creation_is_a_permutation_in_the_name() -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "1230", order=(2, 0, 3, 1), rotation=1)
    assert scenario.creation == (3, 1, 2)
    assert scenario.name.endswith(".r1.o2031")
    with pytest.raises(rvads.errors.ScenarioError, match="order must name each of the entrances"):
        rvads.Scenario(rvads.find("stop4"), "1230", order=(0, 1, 1, 2))


def test_misuse() -> None:
    scenario = rvads.Scenario(rvads.find("stop3"), "120")
    with pytest.raises(rvads.errors.ScenarioError, match=r"unknown relation 'rotations'.*did you mean 'rotation'"):
        equivalent(Case(scenario, rvads.Reference), relations="rotations")
    with pytest.raises(
        rvads.errors.ScenarioError, match=r"no scenario is equivalent to stop3-.*rotation by 1: stop3 has other right-of"
    ):
        equivalent(Case(scenario, rvads.Reference))

    class Broken:
        def control(self, seen: Observation) -> Control:
            raise ValueError("no")

    with pytest.raises(rvads.errors.RunError, match="nothing can be compared"):
        equivalent(Case(rvads.Scenario(rvads.find("stop4"), "1100"), Broken))


def test_body_moves_with_its_vehicle() -> None:
    case = Case(
        rvads.Scenario(rvads.find("stop4"), "1030"), rvads.Reference, fleet=rvads.Fleet(others={"a2": rvads.Vehicle(length=5.5)})
    )
    for relation in ("rotation", "mirror"):
        for variant in RELATIONS[relation](case):
            assert isinstance(variant, Variant)
            lengths = {agent.entrance: agent.size and agent.size[0] for agent in variant.case.agents()}
            assert lengths == {variant.image[0]: 4.6, variant.image[2]: 5.5}
