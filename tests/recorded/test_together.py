"""Laws of runs whose vehicles come and go: nobody's verdict depends on who was there at another time, or on where it is cut."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct import static_model
from pytest_rvads.logic.conduct.standing import stopped
from pytest_rvads.logic.conduct.static_model import near, together
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs import recording as recordings
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run, save_run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.satellites.pages.replay import timelines
from pytest_rvads.support.errors import RunError

from .strung import Told, concerning, driven, instances, recorded, strung, uncut

LAW = settings(deadline=None, derandomize=True, max_examples=6)
Make = Callable[..., Run]
Choices = list[tuple[str, str, str, tuple[float, ...]]]
PLACES = {"stop4": "1133", "light4": "2323", "yield4": "2311", "right4": "2222"}


@st.composite
def traffic(draw: st.DrawFn) -> Choices:
    """What three simulations at one junction are made of, see `driven`."""
    place = draw(st.sampled_from(sorted(PLACES)))
    choices = st.tuples(
        st.just(place),
        st.sampled_from([PLACES[place], PLACES[place][::-1], "1302"]),
        st.sampled_from(["reference", "lgsvl", "racer"]),
        st.sampled_from([(8.0, 12.0, 16.0, 9.0), (6.0, 6.0, 14.0, 14.0)]),
    )
    return draw(st.lists(choices, min_size=3, max_size=3))


@pytest.mark.extended
@LAW
@given(traffic(), st.integers(0, 300))
def test_runs_one_after_the_other_are_judged_as_each_by_itself(choices: Choices, gap: int) -> None:
    runs = [driven(*choice) for choice in choices]
    starts = np.cumsum([0, *(run.steps + gap for run in runs[:-1])]).tolist()
    whole = strung(runs, starts)
    for rule in concerning(whole):
        apart: Told = {}
        for number, (run, start) in enumerate(zip(runs, starts, strict=True)):
            apart |= instances(run, rule, start * run.dt, f"{number}-")
        found = instances(whole, rule)
        assert found == {key: apart[key] for key in found}, rule
        # Two that are never near at the same time, such as who left before the other one came, are in no instance there.
        assert {told["status"] for key, told in apart.items() if key not in found} <= {"NA", "PASS"}, rule


@pytest.mark.extended
@LAW
@given(traffic(), st.integers(100, 900))
def test_excerpts_say_what_the_whole_recording_says(choices: Choices, later: int) -> None:
    runs = [driven(*choice) for choice in choices]
    whole = recorded(strung(runs, [later * number for number in range(len(runs))]))
    (single,) = uncut(whole)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recordings, "MOST_JUDGED", 3)
        parts = list(replace(whole))
    assert len(parts) > 1
    for rule in concerning(single):
        found: Told = {}
        for part in parts:
            told = instances(part, rule)
            assert not told.keys() & found.keys(), "judged twice"
            found |= told
        assert found == instances(single, rule), rule


@pytest.mark.extended
@LAW
@given(traffic(), st.integers(50, 900))
def test_vehicles_near_together_yield_every_violation(choices: Choices, later: int) -> None:
    runs = [driven(*choice) for choice in choices]
    starts = [later * number for number in range(len(runs))]
    few, all_present = strung(runs, starts), strung(runs, starts)
    begin, end = few.spans.T
    everybody = frozenset(
        (one, two) for one, two in np.argwhere(np.minimum.outer(end, end) > np.maximum.outer(begin, begin)).tolist() if one != two
    )
    for rule in concerning(few):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(static_model, "together", lambda _run: everybody)
            wanted = instances(all_present, rule)
        found = instances(few, rule)
        decided = {key: told for key, told in wanted.items() if told["status"] in ("FAIL", "OPEN")}
        assert {key: told for key, told in found.items() if told["status"] in ("FAIL", "OPEN")} == decided, rule


def test_cost_grows_with_traffic_not_with_its_square() -> None:
    """Of forty vehicles that come every few seconds, each is near the junction with few others."""
    run = driven("stop4", "1133", "racer", (8.0, 12.0, 16.0, 9.0))
    counts = {}
    for several in (5, 10):
        whole = strung([run] * several, [600 * number for number in range(several)])
        counts[several] = len(together(whole))
    assert counts[10] <= 2.3 * counts[5]
    assert counts[10] < len(whole.agents) * 12


def vanishing(run: Run, **last: int) -> Run:
    """Return a run without positions in which the recording of these vehicles ends with the given ticks."""
    zone = run.zone.copy()
    for name, tick in last.items():
        zone[tick + 1 :, [agent.name for agent in run.agents].index(name)] = Zone.ABSENT
    return replace(run, zone=zone)


@pytest.mark.parametrize("rule", ["p3", "first_come"])
def test_vanished_vehicle_is_owed_nothing(make: Make, rule: str) -> None:
    """a0 was there first; a1 enters after the recording of a0 has ended, or vanishes itself before it may go."""
    both = make("stop4", {0: (2, 0, None, None), 1: (2, 100, 300, 400)}, 500)
    assert check(both, rule).status is Status.FAIL
    first = check(vanishing(both, a0=200), rule)
    assert first.status is Status.OPEN
    assert first.message.endswith("when the recording of a0 ended at 2.00 s")
    assert check(vanishing(both, a1=200), rule).status is Status.OPEN
    assert check(vanishing(both, a0=350), rule).status is Status.FAIL  # it was there when a1 entered


def test_vanishing_at_a_red_light_is_no_violation(make: Make) -> None:
    red = {entrance: [(0, Colour.RED)] for entrance in range(4)}
    run = make("light4", {0: (2, 10, 100, 200)}, 300, red)
    assert check(run, "red").status is Status.FAIL
    for last in (50, 99):
        assert check(vanishing(run, a0=last), "red").status is Status.OPEN
    assert check(vanishing(run, a0=100), "red").status is Status.FAIL


def test_timelines_stop_where_somebody_vanishes(make: Make) -> None:
    both = make("stop4", {0: (2, 0, None, None), 1: (2, 100, 300, 400)}, 500)
    words = [[word for _, word in line.changes] for line in timelines(vanishing(both, a0=200), "p3") if line.moved]
    assert words == [["watching", "due"]]


def test_appearance_at_rest_is_no_full_stop() -> None:
    """As in a run that begins so: it may stand in a queue; it has stopped once it has driven and stands again."""
    run = driven("stop4", "2000", "reference", (8.0,) * 4)
    late = strung([run, run], [0, run.steps + 50])
    alone, again = stopped(run, 0), stopped(late, 1)
    assert (again[run.steps + 50 :] == alone).all()
    assert not again[: run.steps + 50].any()


def test_bodies_without_positions_are_not_judged(make: Make) -> None:
    run = vanishing(make("stop4", {0: (2, 10, 100, 200), 1: (2, 20, 120, 200)}, 300), a0=250)
    verdict = check(run, "no_collision")
    assert (verdict.status, verdict.reason) == (Status.NA, "not recorded: the run holds no positions")
    with pytest.raises(RunError, match="no positions"):
        near(run)


@pytest.mark.parametrize(("dt", "status"), [(0.1, Status.FAIL), (0.01, Status.NA)])
def test_coarse_recording_over_the_entrance_zone_is_judged(make: Make, dt: float, status: Status) -> None:
    """In a tenth of a second a fast car passes the zone of 1 m; in a hundredth none does, and such a recording is damaged."""
    red = {entrance: [(0, Colour.RED)] for entrance in range(4)}
    run = replace(make("light4", {0: (2, 50, 50, 80)}, 100, red), dt=dt)
    assert not (run.zone == Zone.ENTRANCE).any()
    assert check(run, "p4").status is status


@pytest.mark.extended
def test_a_run_of_many_vehicles_is_judged_at_once() -> None:
    """Two hundred that come and go, in one run: no instance is too many, and none costs what all pairs would."""
    run = driven("stop4", "1133", "reference", (8.0, 12.0, 16.0, 9.0))
    coarse = replace(run, dt=0.1, **{name: getattr(run, name)[::10] for name in ("zone", "lights", "station", "speed", "pose")})
    several = strung([coarse] * 50, [coarse.steps * number for number in range(50)])
    assert len(several.agents) == 200
    for rule in ("p1", "p3", "first_come", "right_first", "no_collision", "no_conflict", "progress"):
        once, often = check(coarse, rule), check(several, rule)
        assert often.counts == {word: 50 * count for word, count in once.counts.items()}, rule


def test_coarse_sampling_is_told_once_for_all() -> None:
    run = driven("stop4", "1133", "racer", (8.0, 12.0, 16.0, 9.0))
    coarse = replace(run, dt=0.2, **{name: getattr(run, name)[::20] for name in ("zone", "lights", "station", "speed", "pose")})
    (told,) = [finding.message for finding in validate(coarse) if finding.kind == "sampling"]
    assert ", as do 3 others: in 0.2 s that is more than the entrance zone of 1 m" in told


def test_recorded_runs_share_their_junction(tmp_path: Path) -> None:
    """What is found out about a junction, where ways meet above all, is found out once for thousands of files."""
    run = driven("stop4", "1133", "racer", (8.0, 12.0, 16.0, 9.0))
    other = driven("light4", "2323", "racer", (8.0, 12.0, 16.0, 9.0))
    for name, what in (("one", run), ("two", replace(run, label="two")), ("other", other)):
        save_run(what, tmp_path / f"{name}.npz")
    one, two, third = (load_run(tmp_path / f"{name}.npz") for name in ("one", "two", "other"))
    assert one.junction is two.junction
    assert (one.junction, third.junction) == (run.junction, other.junction)
    assert one == run
