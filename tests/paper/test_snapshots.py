"""Snapshots of violations, and the mutant that goes out of turn."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads import cli
from pytest_rvads.drivers.lgsvl import Constants, LgsvlLike
from pytest_rvads.satellites.paper.experiment import outcome
from pytest_rvads.satellites.paper.snapshots import SHOWN, LastFirst, Snapshot, snapshot, snapshots
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError

# By hand, from where the vehicles stand and the verdicts' reasons; in J of class 4 both right turns enter in the same step.
GUILTY = {"p1": {"a2"}, "p2": {"a0"}, "p3": {"a3"}, "p4": {"a1"}, "p5": {"a1", "a3"}, "p6": {"a2"}}
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def pictures() -> dict[str, Snapshot]:
    return snapshots()


@pytest.mark.extended
@pytest.mark.parametrize("rule", SHOWN)
def test_each_rule_has_pictures_before_and_at_the_violation(pictures: dict[str, Snapshot], rule: str) -> None:
    for svg in (pictures[rule].before, pictures[rule].broken):
        root = ElementTree.fromstring(svg)
        assert len([g for g in root.iter(f"{SVG}g") if g.get("class") == "vehicle"]) >= 2
        zones = [p for p in root.iter(f"{SVG}polygon") if p.get("class") == "zone"]
        assert len(zones) == (rule in ("p1", "p2", "p3")), "the scheduler rules at stop signs only"
        pointed = {g.get("data-agent") for g in root.iter(f"{SVG}g") if any(r.get("class") == "broken" for r in g)}
        assert pointed == GUILTY[rule], "only vehicles that break the rule in this step"


def test_mutant_breaks_p3_and_the_original_keeps_p3() -> None:
    scenario = SHOWN["p3"].scenario()
    assert outcome(simulate(Case(scenario, LastFirst)), ("p3",)) == {"p3": "FAIL"}
    assert outcome(simulate(Case(scenario, LgsvlLike)), ("p3",)) == {"p3": "PASS"}


def test_snapshot_requires_a_violation() -> None:
    run = simulate(Case(SHOWN["p3"].scenario(), LgsvlLike))
    with pytest.raises(RunError, match="no violation of p3 to show"):
        snapshot(run, "p3", Constants())


def title(svg: str) -> str:
    (text,) = (node.text for node in ElementTree.fromstring(svg).iter(f"{SVG}text") if node.get("class") == "title")
    return str(text)


@pytest.mark.extended
def test_titles_name_the_change(pictures: dict[str, Snapshot]) -> None:
    assert title(pictures["p2"].before).endswith("a0 at entrance 0, a1 at entrance 1")
    assert title(pictures["p2"].broken).endswith("a0 in the junction, a1 at entrance 1")
    assert title(pictures["p1"].broken).endswith("a1 in the junction, a2 in the junction")


def test_command_writes_two_pictures_per_rule(
    pictures: dict[str, Snapshot], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pytest_rvads.satellites.paper.snapshots.snapshots", lambda: pictures)
    assert cli.main(["paper", "--snapshots", str(tmp_path / "new")]) == 0
    written = capsys.readouterr().out.splitlines()
    assert [Path(name).name for name in written] == [f"p{k}-{moment}.svg" for k in range(1, 7) for moment in ("before", "broken")]
    assert (tmp_path / "new" / "p3-broken.svg").read_text() == pictures["p3"].broken
    (tmp_path / "file").write_text("")
    assert cli.main(["paper", "--snapshots", str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
