"""Margins, ablation, room and snapshots of violations: how firmly the replication stands."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads import cli
from pytest_rvads.satellites.lgsvl import Constants, LgsvlLike
from pytest_rvads.satellites.paper import evidence
from pytest_rvads.satellites.paper.evidence import (
    FREE,
    SHOWN,
    Free,
    LastFirst,
    Room,
    Snapshot,
    ablation,
    p1_margin,
    rooms,
    snapshot,
    snapshots,
    text_margins,
    text_rooms,
)
from pytest_rvads.satellites.paper.tables import STOP, Entry, Setup, Table, outcome, published, run_entry
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError


@pytest.mark.parametrize(("row", "configuration"), [(0, "C"), (2, "C"), (2, "B")])
def test_margin_of_p1_has_the_sign_of_the_verdict(row: int, configuration: str) -> None:
    run = run_entry(Entry(STOP, 1, row, configuration), Setup())
    together = (run.zone == 2).sum(axis=1) > 1
    margin = p1_margin(run)
    assert (margin < 0) == bool(together.any())
    # Whoever counts ticks with two vehicles inside gets at least the longest such time.
    assert int(together.sum()) >= -margin
    assert abs(margin) >= 8, "the verdict hangs on more than 0.08 s"


@pytest.mark.extended
@pytest.mark.parametrize("name", [name for name, free in FREE.items() if free.tables == (STOP,)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_half_a_foot_of_zone_changes_no_verdict_of_p1(name: str, sign: int) -> None:
    setup = FREE[name].move(0.15 * sign)
    for row, expected in ((1, "FAIL"), (2, "PASS")):  # those with the smallest margins
        assert outcome(run_entry(Entry(STOP, 1, row, "C"), setup), ("p1",)) == {"p1": expected}


@pytest.mark.extended
def test_switched_off_deficiency_flips_its_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    table = Table("light4", "paper_light4", {3: "1233"}, "G", ("p4", "p6"), 40.0)
    monkeypatch.setattr(evidence, "TABLES", (table,))
    cells = {key: value for key, value in published((3,)).items() if key[2] == "G"}
    flips = ablation(cells, names=("i4", "i5"), executor=1)
    assert flips == {"i4": [], "i5": [((3, row, "G", "p6"), "FAIL", "PASS") for row in range(4)]}
    shown = evidence.text_ablation(flips).splitlines()
    assert shown[-2:] == ["I5: 4 cells", "  p6 of G  FAIL -> PASS  class.row 3.1 3.2 3.3 3.4"]


@pytest.mark.extended
def test_room_of_the_draw_is_the_time_at_the_entrance(monkeypatch: pytest.MonkeyPatch) -> None:
    # The crossing vehicle passes its entrance zone in 12 ticks; a right turn that enters then breaks p5, any other does not.
    table = Table("light4", "paper_light4", {4: "2121"}, "J", ("p5",), 40.0)
    monkeypatch.setitem(FREE, "draw", Free(FREE["draw [s]"].move, 0.02, 0.2, (table,)))
    base = {key: value for key, value in published((4,)).items() if key[2:] == ("J", "p5")}
    (room,) = rooms(base, names=("draw",), executor=1).values()
    assert 0.08 <= room.up - room.down <= 0.12
    assert room.down < 0.0 < room.up, "the draw of the tables is not at the edge of its window"


def test_irrelevant_constant_has_its_whole_range(monkeypatch: pytest.MonkeyPatch) -> None:
    table = Table("stop4", "paper_stop4", {1: "2111"}, "A", ("p2",), 5.0)
    monkeypatch.setitem(FREE, "wait", Free(lambda by: Setup(wait=1.0 + by), 0.25, 0.25, (table,)))
    base = {key: value for key, value in published((1,)).items() if key[2:] == ("A", "p2")}
    assert rooms(base, names=("wait",), executor=1) == {"wait": Room(-0.25, 0.25, 0.25)}


def test_texts_of_margins_and_rooms() -> None:
    margins = {(n, row, letter): 10 * n + row for n in STOP.classes for row in range(4) for letter in STOP.configurations}
    margins[2, 3, "C"] = -7
    lines = text_margins(margins).splitlines()
    assert lines[-2].split() == ["2,", "4", "23", "23", "-7", "23", "23"]
    assert lines[-1] == "The closest cell depends on 7 ticks."
    shown = text_rooms({"halt [m]": Room(-0.35, 0.2, 0.35)}).splitlines()[1]
    assert shown.split("  ")[0] == "halt [m]"
    assert "-0.35 or more" in shown
    assert shown.endswith("+0.20")


def test_null_models_are_printed_without_a_simulation(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["paper", "null-models"]) == 0
    assert "by rule and configuration        117 of 120" in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("wrong", [["--json"], ["--simulator", "bullet"], ["--svg", "x.svg"]])
def test_options_of_the_tables_are_refused_with_evidence(wrong: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["paper", "null-models", *wrong]) == 2
    assert "options of the tables" in capsys.readouterr().err


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
    monkeypatch.setattr("pytest_rvads.satellites.paper.evidence.snapshots", lambda: pictures)
    assert cli.main(["paper", "snapshots", "--svg", str(tmp_path / "new")]) == 0
    written = capsys.readouterr().out.splitlines()
    assert [Path(name).name for name in written] == [f"p{k}-{moment}.svg" for k in range(1, 7) for moment in ("before", "broken")]
    assert (tmp_path / "new" / "p3-broken.svg").read_text() == pictures["p3"].broken
    (tmp_path / "file").write_text("")
    assert cli.main(["paper", "snapshots", "--svg", str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
