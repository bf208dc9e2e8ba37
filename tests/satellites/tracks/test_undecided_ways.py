"""A vehicle that crashes before its way is decided is judged on each of its possible ways; what depends on the way is UNSURE."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.static_model import on_each_way
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_recording, load_run, save_recording, save_run
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.matching import BEFORE, UNCLEAR
from pytest_rvads.support.errors import RunError

from .drives import drive
from .test_pedestrians import person, table

ZEBRA, RIGHT = find("zebra4"), find("right4")
SPEED = 8.0
CRASH = 43.0 / SPEED
"""Time at which the front of a car from station -40 is 3 m behind the entrance vertex: on the near crosswalk of zebra4 [s]."""
Table = Mapping[str, Sequence[Any]]


def struck(key: tuple[int, int]) -> Table:
    """Return the whole log of a car and a pedestrian who is in front of it on the near crosswalk at the time `CRASH`."""
    x, y, _ = Itinerary.through(ZEBRA, *key).pose(3.0)
    middle, _ = ZEBRA.crossings[key[0]].path.project(x, y, 2.0)
    walker = person([(0.0, middle - 1.4 * CRASH, 0.0), (9.0, middle + 1.4 * (9.0 - CRASH), 0.0)], number=key[0])
    return table([walker], [drive(ZEBRA, key, "car", speed=SPEED)])


def until(log: Table, end: float) -> Table:
    """Return the rows of a log up to a time [s]."""
    rows = [k for k, time in enumerate(log["time"]) if time <= end]
    return {name: [column[k] for k in rows] for name, column in log.items()}


def only_run(log: Table, place: Junction) -> Run:
    (run,) = read_tracks(log, place)
    return run


def statuses(run: Run) -> dict[str, Status]:
    return {rule.name: check(run, rule).status for rule in rules_for(("road",), run.junction)}


@pytest.mark.parametrize("headings", [True, False])
@pytest.mark.parametrize("key", [(2, 0), (2, 1), (2, 3)])
def test_crash_on_the_near_crosswalk_is_judged_as_in_the_whole_log(key: tuple[int, int], headings: bool) -> None:
    whole = {name: column for name, column in struck(key).items() if headings or name != "heading"}
    recording = read_tracks(until(whole, CRASH + 0.2), ZEBRA)
    (car,) = (track.agent for track in recording.vehicles)
    assert ({car.exit, *car.other_exits}, recording.left_out) == ({0, 1, 3}, ())
    (cut,), uncut = recording, only_run(whole, ZEBRA)
    for rule in ("crosswalk", "no_collision", "no_conflict"):
        verdict, expected = check(cut, rule), check(uncut, rule)
        assert verdict.status is Status.FAIL, verdict
        assert (verdict.outcome, verdict.responsible) == (expected.outcome, expected.responsible)
        assert verdict.time == pytest.approx(expected.time, abs=0.011)
        assert "the verdict does not depend on the undecided way of car" in verdict.notes


@pytest.mark.parametrize("ends", [-0.15, -0.05, 0.2])
def test_log_may_end_just_before_the_crash(ends: float) -> None:
    assert read_tracks(until(struck((2, 0)), CRASH + ends), ZEBRA).left_out == ()


@pytest.mark.parametrize(("end", "reason"), [(4.0, BEFORE), (CRASH, UNCLEAR)])
def test_without_a_crash_the_vehicle_is_left_out(end: float, reason: str) -> None:
    """The pedestrian has walked past the car, and another car follows with a gap of 3.4 m."""
    walker = person([(0.0, -1.0, 0.0), (CRASH, 6.0, 0.0)], number=2)
    first, second = (drive(ZEBRA, (2, 0), name, speed=SPEED, begin=begin) for name, begin in (("car", -40.0), ("next", -48.0)))
    decided = drive(ZEBRA, (0, 2), "decided", start=-20.0)
    log, before = until(table([walker], [first, second]), end), table([], [decided])
    recording = read_tracks({name: [*log[name], *before[name]] for name in log}, ZEBRA)
    assert [track.agent.name for track in recording.vehicles] == ["decided"]
    assert dict(recording.left_out)["car"] == reason


def test_bodies_that_overlap_from_the_beginning_are_no_crash() -> None:
    twins = [drive(ZEBRA, (2, 0), name, speed=SPEED) for name in ("decided", "car")]
    log = table([], twins)
    rows = [k for k, name in enumerate(log["id"]) if name == "decided" or log["time"][k] <= CRASH]
    recording = read_tracks({name: [column[k] for k in rows] for name, column in log.items()}, ZEBRA)
    assert recording.left_out == (("car", UNCLEAR),)


def meeting() -> Run:
    """Return a run in which a car that has just entered right4 touches a car from its right that turns left."""
    first = drive(RIGHT, (0, 3), "v1", speed=SPEED, begin=6.0 - 4.0 * SPEED)
    second = drive(RIGHT, (1, 0), "v2", speed=SPEED, begin=22.0 - 4.0 * SPEED)
    return only_run(until(table([], [first, second]), 4.0), RIGHT)


def queue() -> Run:
    """Return a run in which a car runs into the car ahead, both on the approach of right4."""
    ahead = drive(RIGHT, (0, 2), "v1", speed=SPEED / 2, begin=-4.0 - 2.0 * SPEED)
    behind = drive(RIGHT, (0, 2), "v2", speed=SPEED, begin=-8.0 - 4.0 * SPEED)
    return only_run(until(table([], [ahead, behind]), 4.0), RIGHT)


def on_way(run: Run, exits: Sequence[int]) -> Run:
    """Return a run in which the vehicles go to the given exits, and their ways count as decided."""
    agents = (
        replace(agent, way=run.junction.movements[agent.entrance, exit], other_exits=())
        for agent, exit in zip(run.agents, exits, strict=True)
    )
    return replace(run, agents=tuple(agents))


@pytest.mark.parametrize(("run", "unsure"), [(meeting(), {"keep_lane", "no_conflict", "right_before_left"}), (queue(), set())])
def test_verdict_is_unsure_exactly_if_it_depends_on_the_way(run: Run, unsure: set[str]) -> None:
    exits = [(agent.exit, *agent.other_exits) for agent in run.agents]
    on_ways = [statuses(on_way(run, choice)) for choice in product(*exits)]
    assert len(on_ways) in (3, 9)
    for rule, status in statuses(run).items():
        possible = {on_way[rule] for on_way in on_ways}
        assert ({status} == possible) if len(possible) == 1 else (status is Status.UNSURE), (rule, status, possible)
    assert {rule for rule, status in statuses(run).items() if status is Status.UNSURE} == unsure
    assert check(run, "no_collision").status is Status.FAIL
    for rule in unsure:
        assert "it depends on the undecided way of v1" in check(run, rule).reason


def test_both_cars_of_a_rear_end_crash_are_told() -> None:
    verdict = check(queue(), "no_collision")
    assert verdict.responsible == ("v2",)
    assert "the verdict does not depend on the undecided ways of v1 and v2" in verdict.notes


@pytest.mark.parametrize("number", range(6))
def test_any_two_vehicles_are_on_all_combinations_of_their_ways(number: int) -> None:
    run = meeting()
    agents = tuple(replace(run.agents[0], name=f"v{k}") for k in range(number))
    crowd = replace(run, agents=agents, zone=run.zone[:, [0] * number], station=None, speed=None, pose=None)
    runs = list(on_each_way(crowd))
    assert len(runs) <= 9 * max((number - 1).bit_length(), 1)
    assert not any(agent.other_exits for possible in runs for agent in possible.agents)
    for one, other in product(range(number), repeat=2):
        pairs = {(possible.agents[one].exit, possible.agents[other].exit) for possible in runs}
        assert pairs == set(product((1, 2, 3), repeat=2)) if one != other else len(pairs) == 3


def test_undecided_ways_are_kept_in_files_and_in_the_hash(tmp_path: Path) -> None:
    recording, run = read_tracks(until(struck((2, 0)), CRASH), ZEBRA), meeting()
    save_recording(recording, tmp_path / "log.npz")
    assert [part.hash for part in load_recording(tmp_path / "log.npz")] == [part.hash for part in recording]
    save_run(run, tmp_path / "run.npz")
    assert load_run(tmp_path / "run.npz").agents == run.agents
    first, second = run.agents
    fewer, elsewhere = (replace(run, agents=(replace(first, other_exits=exits), second)) for exits in ((2,), (0,)))
    assert len({run.hash, fewer.hash, on_way(run, (3, 0)).hash}) == 3
    save_run(elsewhere, tmp_path / "elsewhere.npz")
    with pytest.raises(RunError, match="v1 goes from entrance 0 to exit 0, where no way leads"):
        load_run(tmp_path / "elsewhere.npz")


def test_commands_tell_which_ways_are_not_decided(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, recording = tmp_path / "log.csv", str(tmp_path / "log.npz")
    rows = until(struck((2, 0)), CRASH + 0.2)
    with log.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([rows.keys(), *zip(*rows.values(), strict=True)])
    assert main(["import", str(log), "--junction", "zebra4", "-o", recording]) == 0
    assert "car crashed before its way was decided" in capsys.readouterr().out
    main(["check", recording, "--rules", "no_collision", "--json"])
    output = capsys.readouterr()
    assert "verdicts that depend on the undecided way of car are UNSURE" in output.err
    assert [entry["no_collision"]["status"] for entry in json.loads(output.out).values() if isinstance(entry, dict)] == ["FAIL"]
