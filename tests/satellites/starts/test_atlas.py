"""The atlas of starts, on starts that a function judges: pieces, probes and equal lines."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.starts import all_lines as drawing
from pytest_rvads.satellites.starts.all_lines import Atlas, Strip, draw_atlas
from pytest_rvads.satellites.starts.lines import Line, Setting, lines_at

from ...synthetic_starts import Answer, judged_by, lead_of, setting

Make = Callable[..., Run]
PLACE = rvads.find("stop4")
GROUP = lines_at(PLACE)[0]
LOW, HIGH = -600, 600
"""Reach of a line of an atlas [steps]: 6 s at either side."""
GRID = 50
"""Distance of the starts that are simulated in any case [steps]: 0.5 s."""


def drawn(answer: Answer, make: Make, group: Sequence[Line] = GROUP[:1], probes: int = 0, seed: int = 0) -> Atlas:
    """Return the atlas of a group of lines whose starts a function judges."""
    with judged_by(answer, make), pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "lines_at", lambda *_, **__: (tuple(group),))
        return draw_atlas(PLACE, setting(), probes=probes, seed=seed, executor=1)


def verdicts_of(changes: Sequence[int]) -> Answer:
    """Return a function whose verdicts change at each of the leads; no two neighbouring pieces have equal verdicts."""

    def answer(lead: int) -> tuple[bool, Mapping[str, Status]]:
        number = sum(change <= lead for change in changes)
        return number % 2 == 1, {"no_collision": Status.FAIL if number % 4 > 1 else Status.PASS}

    return answer


def spans(strip: Strip) -> list[tuple[int, int]]:
    """Return the first and the last lead of every piece."""
    return [(piece.first, piece.last) for piece in strip.pieces]


def expected(changes: Sequence[int]) -> list[tuple[int, int]]:
    """Return the first and the last lead of the pieces between changes."""
    return [(first, after - 1) for first, after in pairwise([LOW, *changes, HIGH + 1])]


changes = st.lists(st.integers(GRID, 200), max_size=12).map(
    lambda lengths: [lead for k in range(len(lengths)) if (lead := LOW + sum(lengths[: k + 1])) <= HIGH - GRID]
)
"""Leads at which verdicts change, with pieces of at least 0.5 s between them."""


@given(changes)
@settings(deadline=None, derandomize=True, max_examples=12)
def test_changes_between_pieces_longer_than_the_grid_are_all_found(make: Make, changes: list[int]) -> None:
    answer = verdicts_of(changes)
    (strip,) = drawn(answer, make).strips
    assert spans(strip) == expected(changes)
    for piece in strip.pieces:
        assert piece.start == strip.at(piece.first).start == strip.at(piece.last).start
        assert piece.first <= piece.start.lead <= piece.last
        assert (piece.start.goes, dict(piece.start.outcomes)) == answer(piece.first)


@given(st.sets(st.integers(LOW + 1, HIGH), max_size=30).map(sorted))
@settings(deadline=None, derandomize=True, max_examples=12)
def test_pieces_partition_the_reach_and_neighbours_differ(make: Make, changes: list[int]) -> None:
    """Some of these pieces are so short that the atlas misses them."""
    (strip,) = drawn(verdicts_of(changes), make).strips
    assert [piece.first for piece in strip.pieces] == [LOW, *(piece.last + 1 for piece in strip.pieces[:-1])]
    assert strip.pieces[-1].last == HIGH
    for piece, after in pairwise(strip.pieces):
        assert (piece.start.goes, piece.start.outcomes) != (after.start.goes, after.start.outcomes)
        assert {piece.last, after.first} <= set(strip.simulated), "a change lies between two simulated starts"
    for lead in strip.simulated:
        at = strip.at(lead).start
        assert (at.goes, dict(at.outcomes)) == verdicts_of(changes)(lead)


@given(changes, st.integers(0, 5))
@settings(deadline=None, derandomize=True, max_examples=5)
def test_probes_agree_with_an_atlas_that_misses_no_piece(make: Make, changes: list[int], seed: int) -> None:
    atlas = drawn(verdicts_of(changes), make, probes=60, seed=seed)
    assert (atlas.probes, atlas.differing) == (60, ())


HIDDEN = range(5, 45)
"""A piece between two starts of the grid, 0.00 s and 0.50 s."""


def going_when_hidden(lead: int) -> tuple[bool, Mapping[str, Status]]:
    """Return verdicts with one piece in the middle, which the grid misses."""
    return lead in HIDDEN, {"no_collision": Status.PASS}


def test_probes_report_a_piece_between_two_starts_of_the_grid(make: Make) -> None:
    atlas = drawn(going_when_hidden, make, probes=250)
    (strip,) = atlas.strips
    assert spans(strip) == [(LOW, HIGH)], "the grid misses the piece"
    assert atlas.differing
    for probe in atlas.differing:
        assert probe.lead in HIDDEN
        assert (probe.inferred.goes, probe.error) == (False, "")


def test_first_probes_of_a_greater_number_are_those_of_a_smaller_number(make: Make) -> None:
    few, many, other = (
        [probe.lead for probe in drawn(going_when_hidden, make, probes=probes, seed=seed).differing]
        for probes, seed in ((120, 0), (250, 0), (250, 1))
    )
    assert few
    assert len(few) < len(many)
    assert many[: len(few)] == few
    assert other[: len(few)] != few


def test_further_lines_of_a_group_need_fewer_starts_if_the_driver_does_the_same_there(make: Make) -> None:
    changes = [-333, 77]
    first, *more = drawn(verdicts_of(changes), make, GROUP).strips
    assert len(more) == 3
    # A grid of 25 starts; then three pieces, each with its first, middle and last start.
    assert len(first.simulated) > 25
    for strip in more:
        assert spans(strip) == spans(first) == expected(changes)
        assert len(strip.simulated) == 9


def errors_at(failing: Callable[[int], bool], make: Make, probes: int) -> Atlas:
    """Return the atlas of a group of lines on which a driver raises an error, at some starts of the seat 0 only."""
    with judged_by(verdicts_of([-333, 77]), make), pytest.MonkeyPatch.context() as patch:
        judged = Setting.judged

        def divides_by_zero(self: Setting, scenario: rvads.Scenario) -> object:
            if scenario.subject == 0 and failing(lead_of(scenario)):
                raise rvads.errors.RunError("the driver divides by zero")
            return judged(self, scenario)

        patch.setattr(Setting, "judged", divides_by_zero)
        patch.setattr(drawing, "lines_at", lambda *_, **__: (GROUP,))
        return draw_atlas(PLACE, setting(), probes=probes, executor=1)


def test_error_of_the_driver_on_a_line_leaves_the_other_lines_their_strips(make: Make) -> None:
    failing, *others = errors_at(lambda lead: lead >= 300, make, 20).strips
    assert (failing.error, failing.pieces) == ("the driver divides by zero", ())
    assert max(failing.simulated) < 300, "the certificate lists the starts before the error"
    assert len(others) == 3
    for strip in others:
        assert (strip.error, spans(strip)) == ("", expected([-333, 77]))


def test_error_of_the_driver_at_a_probe_is_reported_and_the_other_probes_are_compared(make: Make) -> None:
    atlas = errors_at(HIDDEN.__contains__, make, 1000)
    assert atlas.probes == 1000
    assert atlas.differing
    for probe in atlas.differing:
        assert (probe.line, probe.error) == (GROUP[0], "the driver divides by zero")
        assert probe.lead in HIDDEN


@pytest.mark.parametrize("order", [1, -1])
def test_strip_reaches_as_far_as_its_own_vehicles_have_room(make: Make, order: int) -> None:
    first, second, *_ = GROUP
    lanes = tuple(replace(lane, setback=lane.approach.length - 32.0) for lane in PLACE.entrances if lane.approach)
    narrow = replace(second, place=replace(PLACE, entrances=lanes))
    # At 8 m/s, a vehicle with 32 m of approach starts at most 4 s before its line; the nearest start is 2.5 s before it.
    reaches = [(LOW, HIGH), (-149, 149)][::order]
    strips = drawn(verdicts_of([0]), make, [first, narrow][::order]).strips
    assert [(strip.pieces[0].first, strip.pieces[-1].last) for strip in strips] == reaches
    assert [{first, last} <= set(strip.simulated) for strip, (first, last) in zip(strips, reaches, strict=True)] == [True, True]


def test_line_without_room_has_no_strip_and_a_reason() -> None:
    lanes = tuple(replace(lane, setback=lane.approach.length) for lane in PLACE.entrances if lane.approach)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "lines_at", lambda *_, **__: ([replace(GROUP[0], place=replace(PLACE, entrances=lanes))],))
        (strip,) = draw_atlas(PLACE, setting(), probes=3, executor=1).strips
    assert (strip.pieces, strip.error) == ((), "")
    assert "does not fit on entrance" in strip.unfit
