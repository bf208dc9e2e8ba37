"""Critical starts: laws of the search on starts that a function judges, and real drivers at a few lines."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.geometry.finder import names
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.starts.critical import CriticalStart, Order, bisected, critical_starts, failure
from pytest_rvads.satellites.starts.lines import Fault, Line, Setting, fault_of, lines_at
from pytest_rvads.scenarios.ids import from_id
from pytest_rvads.support.errors import OpenObligation, RuleViolation, ScenarioError

from ...drivers.blind import BLIND
from ...synthetic_starts import Answer, judged_by, setting

Make = Callable[..., Run]
PASS, FAIL, OPEN, NA = Status.PASS, Status.FAIL, Status.OPEN, Status.NA
GROUP = lines_at(rvads.find("stop4"))[0]
LINE = GROUP[0]
LINES = [line for name in ("stop4", "light4", "yield4") for group in lines_at(rvads.find(name)) for line in group]
LOW, HIGH = -1200, 1200
"""Reach of the line [steps]: 12 s at either side."""
FARTHEST = 150
"""Every side of a line has a tried start that is 1.5 s or more less critical than the critical start [steps]."""
leads = st.integers(LOW + 1, HIGH)


def searched(answer: Answer, make: Make, line: Line = LINE) -> dict[Order, CriticalStart]:
    """Return both sides of a line whose starts a function judges."""
    with judged_by(answer, make):
        return {side.order: side for side in critical_starts([[line]], setting(), 1)}


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.integers(-50, 50), st.integers(1, 200), st.data())
def test_bisected_is_the_least_number_that_holds(low: int, apart: int, data: st.DataObject) -> None:
    least = data.draw(st.integers(low + 1, low + apart))
    tried: list[int] = []

    def holds(number: int) -> bool:
        tried.append(number)
        return number >= least

    assert bisected(holds, low, low + apart) == least
    assert len(tried) <= apart.bit_length(), "every try halves what is left"


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.sets(st.integers(1, 60)))
def test_bisected_is_a_number_that_holds_after_a_number_that_does_not(others: set[int]) -> None:
    holding = {*others, 61}
    number = bisected(holding.__contains__, 0, 61)
    assert number in holding
    assert number - 1 not in holding


@settings(deadline=None, derandomize=True, max_examples=12)
@given(leads)
def test_critical_starts_are_the_last_that_waits_and_the_first_that_goes(make: Make, turn: int) -> None:
    sides = searched(lambda lead: (lead >= turn, {"no_collision": PASS}), make)
    assert [sides[order].start.lead for order in Order if sides[order].start] == [turn, turn - 1]
    assert [side.status for side in sides.values()] == [PASS, PASS]


@pytest.mark.parametrize(("goes", "absent", "lead"), [(True, Order.WAITS, LOW), (False, Order.GOES, HIGH)])
def test_driver_that_always_or_never_goes_has_one_order(make: Make, goes: bool, absent: Order, lead: int) -> None:
    sides = searched(lambda _lead: (goes, {"no_collision": PASS}), make)
    assert sides[absent].start is None
    assert sides[absent].status == "NA"
    (present,) = set(Order) - {absent}
    assert sides[present].start is not None
    assert sides[present].start.lead == lead


@pytest.mark.parametrize(
    ("rule", "fault"),
    [
        ("no_collision", Fault.BOLD),
        ("first_come", Fault.BOLD),
        ("mine", Fault.BOLD),
        ("progress", Fault.TIMID),
        ("full_stop", Fault.MANNERS),
        ("speed_limit", Fault.MANNERS),
    ],
)
def test_failure_at_the_critical_start_is_of_the_kind_of_its_rule(make: Make, rule: str, fault: Fault) -> None:
    assert fault_of(rule) is fault
    sides = searched(lambda lead: (lead >= 7, {"on_route": PASS, rule: FAIL if lead == 7 else PASS}), make)
    goes = sides[Order.GOES]
    assert (goes.fault, goes.rule, goes.status, goes.failed) == (fault, rule, "FAIL", goes.start)
    assert goes.explanation == f"{rule} is judged FAIL"
    assert sides[Order.WAITS].fault is None


@settings(deadline=None, derandomize=True, max_examples=12)
@given(st.integers(-700, 700), st.integers(1, FARTHEST), st.sampled_from(Order))
def test_failure_only_at_less_critical_starts_is_irrational(make: Make, turn: int, more: int, order: Order) -> None:
    """All starts that are at least `more` steps less critical fail, so the first of them has a passing neighbour."""
    critical, sign = (turn, 1) if order is Order.GOES else (turn - 1, -1)

    def answer(lead: int) -> tuple[bool, Mapping[str, Status]]:
        return lead >= turn, {"no_collision": FAIL if sign * (lead - critical) >= more else PASS}

    side = searched(answer, make)[order]
    assert side.start is not None
    assert side.failed is not None
    assert (side.fault, side.rule) == (Fault.IRRATIONAL, "no_collision")
    assert (side.start.lead, side.failed.lead) == (critical, critical + sign * more)
    assert "0.01 s less critical" in side.explanation


def test_rule_about_the_subject_itself_is_never_irrational(make: Make) -> None:
    """What the subject does by itself need not depend on how near the other vehicle is."""
    goes = searched(lambda lead: (lead >= 0, {"full_stop": FAIL if lead >= 20 else PASS}), make)[Order.GOES]
    assert goes.failed is not None
    assert (goes.fault, goes.failed.lead, goes.explanation) == (Fault.MANNERS, 20, "full_stop is judged FAIL")


def test_rule_about_other_vehicles_comes_before_a_rule_about_the_subject_itself(make: Make) -> None:
    def answer(lead: int) -> tuple[bool, Mapping[str, Status]]:
        return lead >= 0, {"full_stop": FAIL, "progress": FAIL, "no_collision": FAIL if lead >= 100 else PASS}

    sides = searched(answer, make)
    assert (sides[Order.GOES].rule, sides[Order.GOES].fault) == ("no_collision", Fault.IRRATIONAL)
    assert (sides[Order.WAITS].rule, sides[Order.WAITS].fault) == ("progress", Fault.TIMID)
    error = failure(list(sides.values()), setting())
    assert isinstance(error, RuleViolation)
    assert str(error).startswith(f"{LINE}, irrational where it goes: no_collision FAIL, lead +1.00 s, in stop4-")
    assert str(error).endswith(", and 1 more of 2 orders")


def test_critical_starts_that_pass_are_no_failure(make: Make) -> None:
    sides = searched(lambda lead: (lead >= 0, {"no_collision": PASS, "full_stop": NA}), make)
    assert failure(list(sides.values()), setting()) is None


def test_open_obligation_is_reported_as_open(make: Make) -> None:
    error = failure(list(searched(lambda lead: (lead >= 0, {"progress": OPEN}), make).values()), setting())
    assert isinstance(error, OpenObligation)


def test_line_without_room_has_no_start(make: Make) -> None:
    lanes = tuple(replace(lane, setback=lane.approach.length) for lane in LINE.place.entrances if lane.approach)
    sides = list(searched(lambda _lead: (True, {}), make, replace(LINE, place=replace(LINE.place, entrances=lanes))).values())
    assert all("does not fit" in side.unfit for side in sides)
    with pytest.raises(ScenarioError, match=r"no start could be simulated: distance .* does not fit on entrance"):
        failure(sides, setting())


@settings(deadline=None, derandomize=True, max_examples=5)
@given(st.lists(st.integers(LOW + 1, HIGH), min_size=4, max_size=4))
def test_every_line_of_a_group_has_its_own_critical_starts(make: Make, turns: list[int]) -> None:
    def answer(turn: int) -> Answer:
        return lambda lead: (lead >= turn, {"no_collision": PASS})

    with judged_by([answer(turn) for turn in turns], make):
        sides = list(critical_starts([GROUP], setting(), 1))
    assert [side.start.lead for side in sides if side.start] == [
        lead for line in GROUP for lead in (turns[line.seat], turns[line.seat] - 1)
    ]


@settings(deadline=None, derandomize=True, max_examples=5)
@given(st.integers(LOW + 101, HIGH - 101))
def test_further_lines_of_a_group_need_six_runs_if_the_driver_does_the_same_there(make: Make, turn: int) -> None:
    """Two critical starts, and at either side the starts 0.3 s and 1 s less critical."""
    with judged_by(lambda lead: (lead >= turn, {"no_collision": PASS}), make) as judged:
        sides = list(critical_starts([GROUP[:1]], setting(), 1))
        first = len(judged)
        sides = list(critical_starts([GROUP], setting(), 1))
    assert len(judged) == first + first + 3 * 6
    assert {side.status for side in sides} == {PASS}


REFERENCE = rvads.traffic("reference")
"""The reference with the tie window of the rules of the road."""


def simulated(driver: Any, line: Line) -> list[CriticalStart]:
    """Return both sides of a line, simulated and judged by the rules of the road."""
    return list(critical_starts([[line]], Setting.of(driver, rules_for("road")), 1))


@pytest.mark.parametrize(
    "place", ["stop4", *[pytest.param(name, marks=pytest.mark.extended) for name in ("yield4", "right4", "light4")]]
)
def test_reference_passes_at_the_critical_starts_of_a_line(place: str) -> None:
    sides = simulated(REFERENCE, lines_at(rvads.find(place))[0][0])
    assert all(side.start for side in sides), "the reference waits at some starts, and goes at others"
    assert [(side.status, side.fault) for side in sides] == [("PASS", None)] * 2


@pytest.mark.slow
@pytest.mark.parametrize("place", names())
def test_reference_passes_at_all_critical_starts_of_a_junction(place: str) -> None:
    found = critical_starts(lines_at(rvads.find(place)), Setting.of(REFERENCE, rules_for("road")))
    assert [(str(side.line), side.rule, side.explanation) for side in found if side.fault or side.unfit] == []


@pytest.mark.parametrize(
    ("id", "rule"),
    [
        # A driver that had begun to stop on yellow set off again when its lagging brakes left less room than it counted on.
        ("light4-class00-as2300-s0-cfgd88.08_00.30_20.00_20.00v08.00_00.00_00.00_00.00.e9", "red"),
        # A driver turned right on red a moment before the vehicle that waited at the entrance to its left got green.
        ("light4-class00-as1002-s0-cfgd88.08_20.00_20.00_00.30v08.00_00.00_00.00_00.00.e9", "right_on_red"),
    ],
)
def test_reference_stops_at_the_end_of_green_until_it_has_the_right_of_way(id: str, rule: str) -> None:
    setting = Setting.of(REFERENCE, rules_for("road"))
    _, verdicts = setting.judged(from_id(id))
    assert rule in {verdict.rule for verdict in verdicts}
    assert [verdict.explanation for verdict in verdicts if verdict.outcome.bad] == []


@given(st.sampled_from(LINES), st.data())
@settings(deadline=None, derandomize=True, max_examples=60)
def test_id_gives_the_start(line: Line, data: st.DataObject) -> None:
    start = line.scenario(data.draw(st.integers(*line.reach())))
    assert from_id(setting().id(start)) == start


def test_run_of_an_id_is_the_run_of_the_start() -> None:
    start = next(line for group in lines_at(rvads.find("light4")) for line in group if line.by_light).scenario(300)
    setting = Setting.of(REFERENCE, rules_for("red"))
    (run, verdicts), (again, verdicts_again) = setting.judged(start), setting.judged(from_id(setting.id(start)))
    assert run.hash == again.hash
    assert verdicts == verdicts_again


@pytest.mark.extended
@pytest.mark.parametrize(
    ("driver", "line"),
    [  # the other vehicle comes from where the subject does not look, or waits while the subject is inside, or has priority
        ("blind left", "stop4-s1-1to0-meets-0to2"),
        ("blind right", "stop4-s3-3to1-meets-0to1"),
        ("blind ahead", "stop4-s2-2to1-meets-0to1"),
        ("blind to whoever is inside", "stop4-s3-3to1-meets-0to1"),
        ("deaf to fast vehicles", "yield4-s0-0to1-meets-3to1"),
        ("gaps a second too short", "yield4-s0-0to1-meets-3to1"),
    ],
)
def test_driver_that_overlooks_vehicles_breaks_a_rule_about_other_vehicles(driver: str, line: str) -> None:
    place = next(candidate for candidate in LINES if candidate.id == line)
    sides = simulated(BLIND[driver], place)
    assert Fault.BOLD in {fault_of(side.rule) for side in sides if side.fault}


@pytest.mark.extended
def test_vehicle_that_sets_off_before_it_knows_of_the_red_light_fails_from_rest() -> None:
    """Deficiency I1 of the LGSVL-like autopilot."""
    line = next(line for line in LINES if line.id == "light4-s3-3to1-meets-0to1-rest")
    sound: dict[str, Any] = {f"i{number}": False for number in range(1, 6)}
    sets_off, waits = (Setting.of(partial(rvads.LgsvlLike, **sound | {"i1": i1}), rules_for("red"), None) for i1 in (True, False))
    (with_i1, _), (without, _) = (critical_starts([[line]], setting, 1) for setting in (sets_off, waits))
    assert (with_i1.rule, with_i1.fault) == ("red", Fault.BOLD)
    assert without.status == "PASS"


@pytest.mark.extended
def test_number_of_processes_does_not_change_the_answer() -> None:
    groups, setting = [group[:1] for group in lines_at(rvads.find("stop3"))[:2]], Setting.of(REFERENCE, rules_for("road"))
    assert list(critical_starts(groups, setting, 1)) == list(critical_starts(groups, setting, 2))


def test_error_of_the_driver_on_a_line_leaves_the_other_lines_their_verdicts(make: Make) -> None:
    failing, other = LINE, lines_at(rvads.find("stop4"))[4][0]
    passes = judged_by(lambda lead: (lead >= 0, {"no_collision": PASS}), make)
    with passes, pytest.MonkeyPatch.context() as monkeypatch:
        judged = Setting.judged

        def divides_by_zero(self: Setting, scenario: rvads.Scenario) -> object:
            if scenario.directions == failing.directions:
                raise rvads.errors.RunError("the driver divides by zero")
            return judged(self, scenario)

        monkeypatch.setattr(Setting, "judged", divides_by_zero)
        sides = list(critical_starts([[failing], [other]], setting(), 1))
        assert [(side.status, side.error) for side in sides[:2]] == [("ERROR", "the driver divides by zero")] * 2
        assert [side.status for side in sides[2:]] == ["PASS", "PASS"]
        with pytest.raises(rvads.errors.RunError, match="divides by zero"):
            failure(sides, setting())


@pytest.mark.parametrize("rule", ["full_stop", "keep_lane", "on_lane_allowed", "on_route", "speed_limit", "progress"])
def test_rules_about_the_subject_alone_are_rules_of_the_road(rule: str) -> None:
    assert rule in {road.name for road in rules_for("road")}
    assert fault_of(rule) is (Fault.TIMID if rule == "progress" else Fault.MANNERS)
