"""Coverage of arrivals, from runs and records written by hand."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from pytest_rvads.cli.report_commands import merge
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.kpis import arrival_differences, kpis
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.counting import Counts, counts_of
from pytest_rvads.report.figures import SIMULTANEOUS, Tried, arrivals_line, pairs_tried, untested
from pytest_rvads.report.outline import Figures, outline
from pytest_rvads.report.record import Record, conclude, of_run, planned_record
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.terminal import summary
from pytest_rvads.runs.measured import ArrivalDifferences
from pytest_rvads.runs.run import Excerpt, Facts, Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.satellites.pages.page import page

Arrivals = Mapping[tuple[int, int], float | None]
"""Per movement, the time at which its vehicle arrives [s]; None for a vehicle that never arrives."""

STRAIGHT, FROM_RIGHT, FROM_LEFT, TURNS_RIGHT = (0, 2), (1, 3), (3, 1), (2, 3)
"""Movements of a four-way junction: three that cross each other, and a right turn from the arm opposite, which no one crosses."""


def driven(arrivals: Arrivals, subject: str | None = "a0", place: Junction | None = None, **more: Any) -> Run:
    """Return a run of zones, one state every 0.5 s for 20 s, whose vehicles arrive at the entrance zone at these times."""
    place = place or find("stop4")
    zone = np.full((41, len(arrivals)), Zone.APPROACH, dtype=np.int8)
    for column, time in enumerate(arrivals.values()):
        if time is not None:
            zone[round(time * 2) :, column] = Zone.ENTRANCE
    agents = tuple(Agent(f"a{way[0]}", place.movements[way]) for way in arrivals)
    lights = np.zeros((41, place.ways), dtype=np.int8)
    return Run("by hand", place, agents, zone, lights, 0.5, facts=Facts(subject=subject), **more)


def tried(run: Run) -> tuple[tuple[int, int, float], ...]:
    """Return the differences of a run between movements whose conflicts are known."""
    differences = arrival_differences(run)
    assert differences is not None
    return differences.tried


def record(run: Run, number: int = 0, status: str = "PASS", **more: Any) -> Record:
    """Return the record of an item that judges a run."""
    keys = {"junction": "stop4", "cls": 1, "scenario": "1111", "cfg": "C", "rotation": 0, "seat": 0, "rule": "progress"}
    start = planned_record(f"t.py::test[{number}]", 3, "test", keys, run.junction.ways)
    outcome = {"PASS": "passed", "NA": "skipped"}[status]
    made = conclude(start, [Verdict("", Status(status), "")], "call", outcome)
    return structs.replace(made, **{**of_run(run), "arrivals": arrival_differences(run), **more})


def coverage(*records: Record) -> Counts:
    return counts_of(Report(records))


def counts(arrivals: Counts) -> dict[tuple[str, str], dict[int, int]]:
    """Return how often each difference was tried, by pair of movements, in ticks of 0.01 s."""
    return {(own, other): dict(tried.counts) for _, own, other, tried in pairs_tried(arrivals)}


def test_differences_are_those_of_the_subject() -> None:
    assert tried(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5, FROM_LEFT: 1.0})) == ((0, 1, 1.5), (0, 2, -2.0))


def test_without_a_subject_every_vehicle_is_under_test() -> None:
    assert tried(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5}, subject=None)) == ((0, 1, 1.5), (1, 0, -1.5))


@pytest.mark.parametrize(
    ("time", "differences"),
    [(0.0, ((0, 1, -6.0),)), (12.0, ((0, 1, 6.0),)), (12.5, ()), (None, ())],
    ids=["starts_in_the_entrance_zone", "six_seconds_later", "more_than_six_seconds_later", "never_arrives"],
)
def test_vehicles_meet_that_arrive_within_six_seconds(time: float | None, differences: Any) -> None:
    assert tried(driven({STRAIGHT: 6.0, FROM_RIGHT: time})) == differences


def test_vehicles_whose_movements_do_not_conflict_never_meet() -> None:
    assert tried(driven({STRAIGHT: 3.0, TURNS_RIGHT: 3.0})) == ()


def test_an_excerpt_has_the_pairs_whose_last_vehicle_it_judges() -> None:
    run = driven({STRAIGHT: 3.0, FROM_RIGHT: 3.5, FROM_LEFT: 4.0}, subject=None, excerpt=Excerpt(judged=("a1",)))
    assert tried(run) == ((0, 1, 0.5), (1, 0, -0.5))


def test_the_arrivals_are_those_of_the_indicators() -> None:
    run = driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5})
    first, second = (vehicle.arrival for vehicle in kpis(run).vehicles)
    assert first is not None
    assert second is not None
    assert tried(run) == ((0, 1, second - first),)


def test_without_centre_lines_no_conflict_is_known() -> None:
    place = find("stop4")
    movements = {key: replace(movement, path=None) for key, movement in place.movements.items()}
    assert arrival_differences(driven({STRAIGHT: 3.0, FROM_RIGHT: 3.0}, place=replace(place, movements=movements))) is None


@pytest.mark.parametrize(("junction", "symmetry", "pairs"), [("stop4", 1, 14), ("yield4", 2, 28)])
def test_pairs_are_counted_up_to_rotations(junction: str, symmetry: int, pairs: int) -> None:
    """From one arm, a right turn meets the two others into its exit.

    Going straight meets all three movements from the right, the left turn from ahead, and from the left all but the right turn.
    A left turn meets all but the right turns from the right and from the left, and all but the left turn from ahead. These are
    2 + 6 + 6 pairs. With yield signs on two arms only half a turn keeps the signs, so there are twice as many pairs.
    """
    differences = arrival_differences(driven({STRAIGHT: 3.0}, place=find(junction)))
    assert differences == ArrivalDifferences(symmetry, pairs)


def test_images_of_a_pair_count_as_one_pair() -> None:
    """The subject of the second run goes straight from arm 1, and a vehicle from arm 2, on its right, goes straight too."""
    runs = driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5}), driven({FROM_RIGHT: 3.0, (2, 0): 1.0}, subject="a1")
    arrivals = coverage(*(record(run, number) for number, run in enumerate(runs)))
    assert counts(arrivals) == {("0.0 to 2.0", "1.0 to 3.0"): {150: 1, -200: 1}}


def test_a_run_counts_once_and_only_if_a_rule_judged_it() -> None:
    run, other = driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5}), driven({STRAIGHT: 3.0, FROM_RIGHT: 5.0})
    arrivals = coverage(record(run, 1, "NA"), record(run, 2), record(run, 3), record(other, 4, "NA"))
    assert counts(arrivals) == {("0.0 to 2.0", "1.0 to 3.0"): {150: 1}}


def test_the_line_tells_orders_pairs_and_the_largest_gap() -> None:
    runs = [driven({STRAIGHT: 3.0, FROM_RIGHT: time}) for time in (1.0, 2.5, 3.0, 3.5, 8.0)]
    runs += [driven({STRAIGHT: 3.0, FROM_LEFT: time}) for time in (3.0, 6.0)]
    line = arrivals_line(coverage(*(record(run, number) for number, run in enumerate(runs))))
    assert line == (
        "arrivals: 2 of 14 pairs of conflicting movements met, the other vehicle 1 times first, 4 together, 2 later; largest "
        "untested gap 6 s (-6 to 0 s) at stop4, vehicle under test from lane 0.0 to 2.0, other vehicle from 3.0 to 1.0"
    )


def test_the_gap_of_a_pair_reaches_from_difference_to_difference() -> None:
    runs = [driven({STRAIGHT: 6.0, FROM_RIGHT: time}) for time in (1.0, 3.0, 7.5, 11.0)]
    ((_, _, _, pair),) = pairs_tried(coverage(*(record(run, number) for number, run in enumerate(runs))))
    assert (pair.gap, pair.length, str(pair)) == ((-3.0, 1.5), 4.5, "4.5 s (-3 to 1.5 s)")


def test_the_histogram_has_bins_of_half_a_second() -> None:
    pair = Tried(Counter({-600: 1, -51: 2, -50: 1, 0: 3, 49: 1, 50: 1, 600: 2}))
    filled = {number * 0.5 - 6.0: count for number, count in enumerate(pair.histogram) if count}
    assert filled == {-6.0: 1, -1.0: 2, -0.5: 1, 0.0: 4, 0.5: 1, 5.5: 2}
    assert pair.orders == (3, 6, 2), "0.5 s apart is together, 0.51 s is not"
    assert pair.bins() == (
        "1 from -6 to -5.5 s, 2 from -1 to -0.5 s, 1 from -0.5 to 0 s, 4 from 0 to 0.5 s, 1 from 0.5 to 1 s, 2 from 5.5 to 6 s"
    )
    assert pair.bars() == "▂·········▄▂█▂·········▄"


@given(st.lists(st.integers(-600, 600), min_size=1))
def test_laws_of_histograms_and_gaps(ticks: list[int]) -> None:
    pair = Tried(Counter(ticks))
    assert sum(pair.histogram) == sum(pair.orders) == len(ticks)
    begin, end = (round(100 * time) for time in pair.gap)
    assert not any(begin < tick < end for tick in ticks), "nothing was tried within the gap"
    assert all(b - a <= end - begin for a, b in pairwise([-600, *sorted(ticks), 600])), "no stretch is longer"
    assert (len(set(ticks)) + 1) * pair.length >= 12.0, "n differences leave n + 1 stretches of 12 s in all"
    assert Tried(Counter([*ticks, (begin + end) // 2])).length <= pair.length, "another difference enlarges no gap"


def figures(report: Report, *, short: bool = False) -> Figures:
    block = outline(report, short)[-1]
    assert isinstance(block, Figures)
    return block


def report(*runs: Run) -> Report:
    return Report(tuple(record(run, number) for number, run in enumerate(runs)))


def test_a_session_of_simultaneous_arrivals_says_so_in_its_last_line() -> None:
    together = report(*(driven({STRAIGHT: 3.0, FROM_RIGHT: time}) for time in (2.5, 3.0, 3.5)))
    text = summary(together, colour=False, width=200, unicode=True)
    assert text.endswith(f"\n{SIMULTANEOUS}\n")
    assert text.count(SIMULTANEOUS) == 1
    assert SIMULTANEOUS in figures(together).lines
    apart = replace(together, records=(*together.records, record(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.0}), 9)))
    assert SIMULTANEOUS not in summary(apart, colour=False, width=200, unicode=True)


def test_a_session_in_which_nobody_met_is_not_called_simultaneous() -> None:
    alone = report(driven({STRAIGHT: 3.0}))
    assert (figures(alone).last, figures(alone).arrivals) == ("", None)
    assert "arrivals: 0 of 14 pairs of conflicting movements met" in figures(alone).lines


def test_the_table_has_a_row_per_pair() -> None:
    block = figures(report(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5, FROM_LEFT: 1.0})))
    assert block.arrivals is not None
    gaps = ["7.5 s (-6 to 1.5 s)", "8 s (-2 to 6 s)"]
    assert [[text for text, _ in row] for row in block.arrivals.rows] == [
        ["stop4", "0.0 to 2.0", "1.0 to 3.0", "0", "0", "1", gaps[0], "·" * 15 + "█" + "·" * 8],
        ["stop4", "0.0 to 2.0", "3.0 to 1.0", "1", "0", "0", gaps[1], "·" * 8 + "█" + "·" * 15],
    ]
    assert block.arrivals.lines[0] == (
        "junction stop4, under test 0.0 to 2.0, other vehicle 1.0 to 3.0, other first 0, together 0, other later 1, largest "
        "untested gap 7.5 s (-6 to 1.5 s): 1 from 1.5 to 2 s"
    )
    assert figures(report(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5})), short=True).arrivals is None


def test_many_junctions_have_a_row_each() -> None:
    whole = report(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5, FROM_LEFT: 1.0}))
    (one,) = whole.records
    block = figures(replace(whole, records=tuple(structs.replace(one, junction=f"J{k}", nodeid=f"{k}") for k in range(5))))
    assert block.arrivals is not None
    rows = [[text for text, _ in row] for row in block.arrivals.rows]
    assert [row[0] for row in rows] == ["J0", "J1", "J2", "J3", "J4"]
    assert rows[0][1:-1] == ["2 of 14", "1", "0", "1", "8 s (-2 to 6 s)"], "the gap is that of the worst pair"


def test_hostile_names_of_junctions_are_texts_in_the_tables_of_the_page() -> None:
    def shown(name: str, junctions: int) -> str:
        whole = report(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5}))
        (one,) = whole.records
        named = (structs.replace(one, junction=f"{name}{k}", nodeid=str(k)) for k in range(junctions))
        return page(replace(whole, records=tuple(named)), Path())

    hostile = "</td></table><script>alert(1)</script>&\"'\u202e\x1b" + "x" * 80
    for junctions in (1, 5):
        harmed, tame = shown(hostile, junctions), shown("y" * 90, junctions)
        assert re.findall("<[a-zA-Z/][^ >]*", harmed) == re.findall("<[a-zA-Z/][^ >]*", tame)
        assert "&lt;script&gt;alert(1)" in harmed
        assert not {"\u202e", "\x1b"} & set(harmed)


def test_the_gate_compares_the_largest_gap() -> None:
    tried = report(*(driven({STRAIGHT: 6.0, FROM_RIGHT: time}) for time in (1.0, 3.0, 7.5, 11.0)))
    assert not untested(tried, 4.5)
    assert untested(tried, 4.49).startswith("the largest untested gap is above 4.49 s: arrivals: 1 of 14 pairs")
    assert untested(report(driven({STRAIGHT: 3.0})), 11.9), "nothing tried covers nothing"
    assert untested(Report(()), 11.9)


def test_shards_add_up() -> None:
    shards = [report(driven({STRAIGHT: 6.0, FROM_RIGHT: time})) for time in (3.0, 9.0)]
    second = replace(shards[1], records=tuple(structs.replace(one, nodeid="t.py::test[1]") for one in shards[1].records))
    whole = merge([("a", shards[0]), ("b", second)])
    assert counts(coverage(*whole.records)) == {("0.0 to 2.0", "1.0 to 3.0"): {-300: 1, 300: 1}}


@pytest.mark.parametrize(
    "changes",
    [{"agents": ()}, {"arrivals": ArrivalDifferences(5, 14)}, {"arrivals": ArrivalDifferences(1, 14, ((0, 7, 1.0),))}],
    ids=["no_agents", "a_rotation_by_more_arms_than_there_are", "an_agent_that_is_not_there"],
)
def test_differences_that_do_not_fit_their_record_are_a_contradiction(changes: dict[str, Any]) -> None:
    made = record(driven({STRAIGHT: 3.0, FROM_RIGHT: 4.5}))
    assert made.contradiction == ""
    assert structs.replace(made, **changes).contradiction.startswith(
        "has differences between arrivals that do not fit 4 arms and "
    )
