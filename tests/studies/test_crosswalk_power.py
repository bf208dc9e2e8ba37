"""Each mutant at crosswalks does what its name says, and the study finds it, where the reference autopilot keeps the rule."""

from itertools import islice

import pytest

import pytest_rvads as rvads
from studies import power
from studies.crosswalk_power import Found, cover, shown, table
from studies.mutants import AT_CROSSWALKS, MUTANTS

SHOWS = [
    ("blind turning right", "0100", 2, ("near", "steady", 0.0), "crosswalk"),
    ("brakes late at crosswalks", "0200", 1, ("far", "steady", -2.0), "crosswalk"),
    ("ignores occlusion", "0200", 1, ("near", "hidden", -1.0), "no_collision"),
    ("ignores the far side", "0200", 1, ("far", "steady", -2.0), "no_collision"),
    ("passes tightly", "0100", 2, ("near", "steady", 1.0), "crosswalk"),
    ("stops on crosswalks", "0200", 1, ("far", "steady", 0.5), "crosswalk"),
    ("waits for ever", "0200", 1, ("near", "waits", 0.0), "progress"),
    ("yields in front only", "0200", 1, ("far", "steady", -2.0), "no_collision"),
]
"""Mutant, directions, crosswalk; side, behaviour and difference [s] of the pedestrian; what tells the mutant."""


@pytest.mark.parametrize(("name", "directions", "crossing", "walker", "rule"), SHOWS, ids=[case[0] for case in SHOWS])
def test_mutant_breaks_the_rule_about_its_fault(
    name: str, directions: str, crossing: int, walker: tuple[str, str, float], rule: str
) -> None:
    side, behaviour, difference = walker
    scenario = rvads.Scenario(
        rvads.find("zebra4").walked,
        directions,
        distance=36,
        speed=8,
        subject=1,
        senses=rvads.Senses(occlusion=behaviour == "hidden"),
        pedestrians=[rvads.Pedestrian(crossing, side, behaviour, difference)],
    )
    assert rule in shown(AT_CROSSWALKS[name], scenario)


def test_eight_documented_mutants_at_crosswalks() -> None:
    assert len(AT_CROSSWALKS) == 8
    assert list(AT_CROSSWALKS) == sorted(AT_CROSSWALKS)
    assert not AT_CROSSWALKS.keys() & MUTANTS.keys()
    assert all(mutant.__doc__ and issubclass(mutant, rvads.Reference) for mutant in AT_CROSSWALKS.values())


def test_cover_draws_the_same_scenarios_again_and_only_those_with_a_pedestrian() -> None:
    drawn = list(islice(cover(), 12))
    assert [scenario.name for scenario in drawn] == [scenario.name for scenario in islice(cover(), 12)]
    assert {scenario.place.name for scenario in drawn} == {"zebra4", "walk4"}
    assert all(len(scenario.pedestrians) == 1 and scenario.subject is not None for scenario in drawn)


def test_table_of_mutants_at_crosswalks() -> None:
    found = [Found("waits for ever", 17, ("progress",), "zebra4-x"), Found("passes tightly", 300, (), "")]
    assert "| waits for ever | Waits for ever for a pedestrian who stands at the kerb. | 17 | progress |" in table(found)
    assert "| > 300 | **survives** |" in table(found)


def test_study_takes_one_measurement_at_a_time(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        power.main(["--crosswalks", "--mutants"])
    assert "not allowed with" in capsys.readouterr().err
