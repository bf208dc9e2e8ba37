"""The reference drives at junctions of Lanelet2 and CommonRoad files and keeps the rules of the road."""

from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.logic.rules.rulebooks import ROAD

from .commonroad_files import commonroad
from .lanelet_files import Crossing


def statuses(scenario: rvads.Scenario) -> dict[str, str]:
    """Return the status of every rule of the road on a run of the reference."""
    run = rvads.simulate(rvads.Case(scenario, rvads.Reference))
    return {rule.name: rvads.check(run, rule).status.value for rule in ROAD}


def crossing(path: Path) -> Path:
    """Write a crossing with an all-way stop."""
    osm = Crossing()
    lines = [("ref_line", osm.line(k, 1.0)) for k in range(4)]
    osm.regulate("all_way_stop", [*(("yield", id) for id in osm.entries), *lines])
    return osm.write(path)


@pytest.mark.extended
@pytest.mark.parametrize("directions", ["1133", "2130"])
def test_reference_keeps_the_rules_at_a_written_all_way_stop(tmp_path: Path, directions: str) -> None:
    junction = rvads.find("4-way all-way stop", crossing(tmp_path / "cross.osm"))
    found = statuses(rvads.Scenario(junction, directions, distance=30.0))
    assert set(found.values()) == {"PASS", "NA"}
    assert found["full_stop"] == found["no_conflict"] == found["keep_lane"] == "PASS"


@pytest.mark.extended
def test_reference_keeps_the_rules_at_a_written_commonroad_crossing(tmp_path: Path) -> None:
    (tmp_path / "cross.xml").write_text(commonroad(), encoding="utf-8")
    found = statuses(rvads.Scenario(rvads.find("J301", tmp_path / "cross.xml"), "2020", distance=30.0))
    assert set(found.values()) == {"PASS", "NA"}
    assert found["no_collision"] == found["progress"] == "PASS"


@pytest.mark.extended
@pytest.mark.parametrize(
    ("file", "junction", "rule"), [("own__all_way_stop", "J3001", "full_stop"), ("awcore__lanelet2_map", "J49", "red")]
)
@pytest.mark.parametrize("directions", ["1133", "2130"])
def test_reference_keeps_the_rules_at_public_junctions(
    shared: Path, file: str, junction: str, rule: str, directions: str
) -> None:
    path = shared / "maps" / "lanelet2" / f"{file}.osm"
    if not path.is_file():
        pytest.skip("the folder ../shared/maps/lanelet2 is absent")
    found = statuses(rvads.Scenario(rvads.find(junction, path), directions, distance=20.0))
    assert set(found.values()) == {"PASS", "NA"}
    assert found[rule] == found["keep_lane"] == "PASS"


def test_option_states_the_side_of_traffic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RVADS_HAND", "right")  # the command changes the variable, and the fixture restores it
    path = str(Crossing(left_hand=True).write(tmp_path / "cross.osm"))
    for hand in ("right", "left"):
        assert main(["--hand", hand, "map", path]) == 0
        assert ("traffic keeps right, as --hand or RVADS_HAND says" in capsys.readouterr().err) == (hand == "right")
    assert main(["--hand", "left", "init", str(tmp_path / "first"), "--map", path]) == 0
    assert f"next: cd {tmp_path / 'first'} && RVADS_HAND=left pytest" in capsys.readouterr().out


@pytest.mark.extended
def test_rules_do_not_depend_on_the_place_of_lanelets(tmp_path: Path) -> None:
    junction = rvads.find("4-way all-way stop", crossing(tmp_path / "cross.osm"))
    case = rvads.Case(rvads.Scenario(junction, "1133", distance=12.0), rvads.Reference)
    compared = rvads.equivalent(case, "road", relations=("motion", "mirror"))
    assert compared.compared == ("moved map", "mirrored map")
    assert {"full_stop", "keep_lane", "no_conflict"} <= set(compared.triggered)
