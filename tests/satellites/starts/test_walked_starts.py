"""Lines of starts with a pedestrian: which lines, their leads, and the start at which waiting turns into going."""

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.walking import KERB
from pytest_rvads.geometry.crosswalks import Side
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.satellites.starts import all_lines
from pytest_rvads.satellites.starts.critical import Order, critical_starts
from pytest_rvads.satellites.starts.lines import STEP, Fault, Line, Setting, Trial, lines_at
from pytest_rvads.scenarios.ids import from_id
from pytest_rvads.scenarios.pedestrians import Crossed
from pytest_rvads.search.falsify import pasteable
from pytest_rvads.support.errors import ScenarioError

ZEBRA = rvads.find("zebra4")


class Holds:
    """Keeps its speed, whoever comes."""

    def control(self, _seen: rvads.Observation) -> rvads.Acceleration:
        return rvads.Acceleration(0.0)


class Stands:
    """Stops at its line for ever."""

    def control(self, _seen: rvads.Observation) -> rvads.Acceleration:
        return rvads.Acceleration(-6.0)


def line(id: str, behaviours: tuple[str, ...] = ("steady",)) -> Line:
    return next(line for group in lines_at(ZEBRA, None, behaviours) for line in group if line.id == id)


def setting(driver: type, *rules: str) -> Setting:
    return Setting.of(driver, rules_for(rules))


def test_lines_are_all_ways_over_crosswalks_from_both_sides_moving_and_from_rest() -> None:
    """12 ways lead over 2 crosswalks each; half a turn keeps a junction with priority, a quarter turn one with lights."""
    groups = lines_at(ZEBRA, None, ["steady"])
    assert [len(group) for group in groups] == [2] * (12 * 2 * 2 * 2 // 2)
    lines = [line for group in groups for line in group]
    assert {line.seat for line in lines_at(ZEBRA, [3], ["steady"])[0]} == {3}
    over = {(line.ways[0], line.walker.crossing) for line in lines if line.walker}
    assert over == {(way, arm) for way in ZEBRA.movements for arm in way}, "the entrance and the exit of an arm have its number"
    assert len({line.id for line in lines}) == len(lines)
    assert lines_at(ZEBRA, None, ["steady", "steady"]) == groups
    assert {line.vista for line in lines} == {"subject gives way"}
    # Of a junction with lights only turns meet pedestrians who walk in the same phase, on the arm that they turn into.
    lit = lines_at(rvads.find("walk4"), None, ["steady"])
    assert [len(group) for group in lit] == [4] * (2 * 2 * 2)
    assert {line.walker and line.walker.crossing == line.ways[0][1] for group in lit for line in group} == {True}


def test_lines_of_two_vehicles_are_unchanged_by_crosswalks() -> None:
    plain, crossed = ([line.id for group in lines_at(rvads.find(name)) for line in group] for name in ("yield4", "zebra4"))
    assert crossed == [id.replace("yield4", "zebra4") for id in plain]


def test_behaviours_have_lines_of_their_own() -> None:
    hidden = [line for group in lines_at(ZEBRA, None, ["darts", "hidden"]) for line in group]
    sides = {(line.walker.behaviour, line.walker.side) for line in hidden if line.walker}
    assert sides == {("darts", Side.NEAR), ("darts", Side.FAR), ("hidden", Side.NEAR)}
    with pytest.raises(ScenarioError, match=r"pedestrians have the behaviours steady, .* got 'runs'"):
        lines_at(ZEBRA, None, ["runs"])
    with pytest.raises(
        ScenarioError, match=r"no way of junction 'stop4' from seats .* gives way to pedestrians: choose a junction"
    ):
        lines_at(rvads.find("stop4"), None, ["steady"])


@pytest.mark.parametrize("begin", ["", "-rest"])
@pytest.mark.parametrize("side", ["n", "f"])
def test_the_reach_ends_where_the_pedestrian_has_crossed(side: str, begin: str) -> None:
    walked = line(f"zebra4-s0-0to2-meets-0{side}.steady{begin}")
    low, high = walked.reach()
    first, last = walked.scenario(low), walked.scenario(high)
    assert (first.pedestrians[0].difference, last.pedestrians[0].difference) == (round(low * STEP, 2), 12.0)
    length = walked.place.every_way[walked.ways[1]].length
    assert length - 1.4 * 2 * STEP < first.walkers()[0].station < length, "within a step or two of the kerb that ends the way"
    with pytest.raises(Crossed):
        walked.scenario(low - 2)
    assert walked.reach(1.0) == (-100, 100)
    starts = {(scenario.start(0), scenario.elapsed) for scenario in (first, last)}
    assert starts == {((0.01, 0.0) if begin else (20.0, 8.0), 0)}
    assert from_id(first.name) == first


@pytest.mark.parametrize("behaviour", ["yields", "waits"])
def test_pedestrian_who_looks_at_the_kerb_has_never_crossed_when_the_run_begins(behaviour: str) -> None:
    walked = line(f"zebra4-s0-0to2-meets-0n.{behaviour}", (behaviour,))
    assert walked.reach() == (-1200, 1200)
    assert walked.scenario(-1200).walkers()[0].station <= -KERB


def test_subject_that_holds_its_speed_goes_if_it_arrives_first() -> None:
    """The lead compares nominal arrivals, and this subject arrives when it nominally does: the turn is at a lead of 0."""
    walked = line("zebra4-s0-0to2-meets-2n.steady")
    waits, goes = sorted(critical_starts([[walked]], setting(Holds, "no_collision"), 1), key=lambda side: side.order)[::-1]
    assert (waits.order, goes.order) == (Order.WAITS, Order.GOES)
    assert waits.start
    assert goes.start
    assert goes.start.lead - waits.start.lead == 1
    assert goes.start.lead * STEP == pytest.approx(0.0, abs=0.05), "within the lags of the plant"
    assert (goes.status, goes.fault) == (Outcome.FAIL, Fault.BOLD)


@pytest.mark.extended
def test_subject_that_stands_never_goes() -> None:
    walked = line("zebra4-s0-0to2-meets-0n.steady-rest")
    goes, waits = critical_starts([[walked]], setting(Stands, "no_collision"), 1)
    assert (goes.start, waits.start and waits.start.lead) == (None, walked.reach()[1])


@pytest.mark.parametrize("behaviour", ["group", "hidden", "stops"])
def test_the_first_of_several_pedestrians_decides(behaviour: str) -> None:
    walked = line(f"zebra4-s1-1to3-meets-1n.{behaviour}", (behaviour,))
    trial = Trial(setting(Holds, "no_collision"), walked)
    assert [trial.start(lead).goes for lead in (-200, 200)] == [False, True]


@pytest.mark.extended
def test_a_strip_shows_who_collides_before_and_after_the_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A subject that regards nobody passes behind the pedestrian, hits the pedestrian, or passes ahead of the pedestrian."""
    walked = line("zebra4-s0-0to2-meets-2n.steady")
    monkeypatch.setattr(all_lines, "lines_at", lambda *_, **__: ((walked,),))
    found = all_lines.draw_atlas(ZEBRA, setting(Holds, "no_collision"), probes=5, behaviours=["steady"], executor=1)
    (strip,) = found.strips
    # Who is to blame for a collision differs within the third piece.
    pieces = dict.fromkeys((p.start.goes, dict(p.start.outcomes)["no_collision"] is not Outcome.PASS) for p in strip.pieces)
    assert list(pieces) == [(False, False), (False, True), (True, True), (True, False)]
    assert not found.differing


def test_code_that_shows_a_start_again_names_the_pedestrian() -> None:
    scenario = line("zebra4-s0-0to2-meets-2f.steady").scenario(-150)
    assert "pedestrians=[rvads.Pedestrian(2, 'far', 'steady', -1.5)]" in pasteable(scenario, "no_collision")
    assert "pedestrians" not in pasteable(scenario.but(pedestrians=()), "no_collision")
