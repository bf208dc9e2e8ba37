"""Scenarios from their ids, and from their records."""

from pathlib import Path

import pytest
from hypothesis import given, settings

import pytest_rvads as rvads
from pytest_rvads.scenarios.ids import from_id, recalled
from pytest_rvads.search import strategies
from pytest_rvads.support.errors import MapError, RvadsError, ScenarioError
from tools.crossings import Layout, opendrive

PLACE = rvads.find("stop4")


@given(strategies.scenarios("stop4") | strategies.scenarios("light3"))
@settings(deadline=None, derandomize=True, max_examples=60)
def test_a_record_gives_its_scenario(scenario: rvads.Scenario) -> None:
    assert recalled(scenario.record(), scenario.place, "here") == scenario


@pytest.mark.parametrize(
    "scenario",
    [
        rvads.Scenario(PLACE, "1133", distance=20, speed=10),
        rvads.Scenario(PLACE, "0120", distance=(1, 2, 3, 4), speed=(0, 1, 0, 2), rotation=3, subject=0, order=(3, 1, 0, 2)),
        rvads.Scenario(PLACE, "1111", followers=2, senses=rvads.Senses(delay=0.2, occlusion=True, range=40.0, seed=12)),
        rvads.Scenario(rvads.find("lanes4"), "13130023", distance=0.3),
        rvads.Scenario(PLACE, "1111", senses=rvads.Senses(occlusion=True)),
        rvads.Scenario(PLACE, "1111", senses=rvads.Senses(occlusion=True), order=(3, 1, 0, 2)),
    ],
    ids=lambda scenario: scenario.name,
)
def test_an_id_gives_its_scenario_with_or_without_policy_and_rule(scenario: rvads.Scenario) -> None:
    for id in (scenario.name, f"{scenario.name}-full_stop", f"{scenario.name}-hesitant-p1"):
        assert from_id(id) == scenario


def test_letters_are_the_configurations_of_the_paper() -> None:
    found = from_id("stop4-class07-as1133-cfgD")
    assert (found.configuration, found.distances, found.speeds) == ("D", (20.0,) * 4, (10.0,) * 4)
    assert from_id("stop4-class07-as1133-cfgE").distances == (0.3, 0.3, 20.0, 20.0)


def test_id_finds_the_junction_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "my town.xodr"
    path.write_text(opendrive(Layout()), encoding="utf-8")
    scenario = rvads.Scenario(rvads.find("1", path), "1133")
    assert from_id(scenario.name, path) == scenario
    with pytest.raises(MapError, match=r"unknown junction 'my_town\.1'"):
        from_id(scenario.name)


@pytest.mark.parametrize(
    ("id", "message"),
    [
        ("", "'' is no id of a scenario"),
        ("stop4-class07-as1133", "is no id of a scenario"),
        ("stop4-class07-as1133-cfgmine", "is no id of a scenario"),
        ("stop4-class08-as1133-cfgD", r"is not the id of the scenario .* did you mean 'stop4-class07-as1133-cfgD'"),
        ("stop4-class07-as113-cfgD", "is for 3 entrances, 'stop4' has 4"),
        ("stop4-class07-as9133-cfgD", "direction 9 is none of entrance 0"),
        ("stop4-class07-as1133-s7-cfgD", "subject must be an occupied entrance"),
        ("stop4-class07-as1133-cfgd1_2v0", "distance needs one value, or one per entrance"),
        ("stop4-class07-as1133-cfgd1..2v0", "no list of numbers"),
        ("stop4-class07-as1133-cfgD.dela00.20", "got 'dela'; did you mean 'delay'"),
        ("stop4-class07-as1133-cfgD.o11", "order must name each of the entrances"),
        ("nowhere4-class07-as1133-cfgD", "unknown junction 'nowhere4'"),
    ],
)
def test_invalid_id_is_refused(id: str, message: str) -> None:
    with pytest.raises(RvadsError, match=message):
        from_id(id)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wait": "soon"}, "here: the field 'wait' must be a number, got 'soon'"),
        ({"senses": {"smell": 1}}, "here: the field 'senses' has a field that senses do not have"),
        ({"aggression": 7}, "here: aggression must be 1, 2 or 3"),
    ],
)
def test_invalid_record_is_refused(change: dict[str, object], message: str) -> None:
    record = rvads.Scenario(PLACE, "1133").record()
    with pytest.raises(ScenarioError, match=message):
        recalled(record | change, PLACE, "here")
    with pytest.raises(ScenarioError, match="the field 'duration' is missing"):
        recalled({name: value for name, value in record.items() if name != "duration"}, PLACE, "here")
