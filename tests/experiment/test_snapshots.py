"""Snapshots of violations, the mutant that goes out of turn, and the margins of p1."""

from functools import partial
from xml.etree import ElementTree

import pytest

from pytest_rvads.autopilots.lgsvl import Constants, LgsvlLike
from pytest_rvads.errors import RunError
from pytest_rvads.experiment.replication import FREE, p1_margin
from pytest_rvads.experiment.snapshots import SHOWN, LastFirst, Snapshot, snapshot, snapshots
from pytest_rvads.experiment.tables import STOP, Entry, Setup, outcome, run_entry
from pytest_rvads.physics.simulation import simulate

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def found() -> dict[str, Snapshot]:
    return snapshots()


@pytest.mark.parametrize("rule", SHOWN)
def test_a_violation_of_every_rule_is_shown_before_and_after(found: dict[str, Snapshot], rule: str) -> None:
    for svg in (found[rule].before, found[rule].broken):
        root = ElementTree.fromstring(svg)
        assert len([g for g in root.iter(f"{SVG}g") if g.get("class") == "vehicle"]) >= 2
        zones = [p for p in root.iter(f"{SVG}polygon") if p.get("class") == "zone"]
        assert len(zones) == (rule in ("p1", "p2", "p3")), "the scheduler rules at stop signs only"
        assert [r for r in root.iter(f"{SVG}rect") if r.get("class") == "broken"], "who is responsible stands out"
    assert found[rule].before != found[rule].broken


def test_the_mutant_breaks_p3_and_the_original_does_not() -> None:
    scenario = SHOWN["p3"].scenario()
    assert outcome(simulate(scenario, LastFirst), ("p3",)) == {"p3": "FAIL"}
    assert outcome(simulate(scenario, LgsvlLike), ("p3",)) == {"p3": "PASS"}


def test_there_is_nothing_to_show_of_a_rule_that_holds() -> None:
    run = simulate(SHOWN["p3"].scenario(), LgsvlLike)
    with pytest.raises(RunError, match="no violation of p3 to show"):
        snapshot(run, "p3", Constants())


@pytest.mark.parametrize(("row", "configuration"), [(0, "C"), (2, "C"), (2, "B")])
def test_the_margin_of_p1_has_the_sign_of_the_verdict(row: int, configuration: str) -> None:
    run = run_entry(Entry(STOP, 1, row, configuration), Setup())
    together = (run.zone == 2).sum(axis=1) > 1
    margin = p1_margin(run)
    assert (margin < 0) == bool(together.any())
    # Whoever counts ticks with two vehicles inside gets at least the longest such time.
    assert int(together.sum()) >= -margin
    assert abs(margin) >= 8, "the verdict hangs on more than 0.08 s"


@pytest.mark.parametrize("name", [name for name, free in FREE.items() if free.tables == (STOP,)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_half_a_foot_of_zone_changes_no_verdict_of_p1(name: str, sign: int) -> None:
    constants = FREE[name].move(Constants(), 0.15 * sign)
    for row, expected in enumerate(("FAIL", "FAIL", "PASS", "FAIL")):
        run = simulate(Entry(STOP, 1, row, "C").scenario(), partial(LgsvlLike, constants=constants))
        assert outcome(run, ("p1",)) == {"p1": expected}
