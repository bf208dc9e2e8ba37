"""What a run's hash holds: everything that a verdict depends on, and nothing else."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check
from pytest_rvads.runs.run import Collision, Facts, Fault, Run, once
from pytest_rvads.runs.runfile import load_run, save_run
from pytest_rvads.runs.states import Colour, Kind, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError

Make = Callable[..., Run]


@pytest.fixture
def run(drive: Make) -> Run:
    return drive("light4", {0: (2, -5.0, [(0, 9.0)]), 2: (3, -9.0, [(0, 8.0)])}, 200, {0: [(0, Colour.GREEN)]})


def moved_line(junction: Junction) -> Junction:
    """The junction with the first stopping line 1 m farther back."""
    first, *others = junction.entrances
    return replace(junction, entrances=(replace(first, setback=1.0), *others))


FACTS: dict[str, Callable[[Run], Any]] = {
    "subject": lambda run: {"facts": replace(run.facts, subject="a0")},
    "another subject": lambda run: {"facts": replace(run.facts, subject="a2")},
    "a size": lambda run: {"agents": (run.agents[0], replace(run.agents[1], size=(12.0, 2.5)))},
    "a kind": lambda run: {"agents": (run.agents[0], replace(run.agents[1], kind=Kind.TRUCK))},
    "speed limit": lambda run: {"facts": replace(run.facts, speed_limit=8.0)},
    "who strayed": lambda run: {"facts": replace(run.facts, strayed=("a2",))},
    "nothing known": lambda run: {"facts": Facts()},
    "lights": lambda run: {"lights": np.where(run.lights == Colour.GREEN, Colour.RED, run.lights).astype(np.int8)},
    "zones": lambda run: {"zone": np.full_like(run.zone, Zone.ENTRANCE)},
    "stations": lambda run: {"station": run.need("station") + 1e-9},
    "speeds": lambda run: {"speed": run.need("speed") + 1e-9},
    "poses": lambda run: {"pose": run.need("pose") + 1e-9},
    "controls": lambda run: {"controls": np.zeros((200, 2, 3))},
    "collisions": lambda run: {"collisions": (Collision(1.0, ("a0", "a2"), 2.0),)},
    "nobody watched collisions": lambda run: {"collisions": None},
    "a fault": lambda run: {"fault": Fault(1.0, "a0", "it broke")},
    "the junction": lambda run: {"junction": moved_line(run.junction)},
    "who is who": lambda run: {"agents": run.agents[::-1]},
    "the time step": lambda run: {"dt": 0.02},
    "the label": lambda run: {"label": "another"},
}


def test_every_fact_counts(run: Run) -> None:
    variants = [run, *(replace(run, **change(run)) for change in FACTS.values())]
    assert len({v.hash for v in variants}) == len(variants)
    assert len({*variants}) == len(variants), "nor are two of them equal"


def test_where_a_run_comes_from_does_not(run: Run) -> None:
    assert replace(run, provenance={"autopilot": "somebody", "speed_limit": 3.0}) == run
    assert replace(run, zone=run.zone.copy(), facts=replace(run.facts)) == run


def test_no_verdict_reads_where_a_run_comes_from(run: Run) -> None:
    told = replace(run, provenance={"subject": "a2", "speed_limit": 1.0, "vehicle": "truck"})
    for rule in ("speed_limit", "keep_lane", "no_conflict", "left_yields"):
        one, other = check(told, rule), check(run, rule)
        assert (one.status, one.message, one.responsible) == (other.status, other.message, other.responsible)


def test_two_runs_that_differ_in_a_fact_are_judged_apart(run: Run) -> None:
    slow = replace(run, facts=replace(run.facts, speed_limit=8.0))
    assert [str(check(r, "speed_limit").status) for r in (run, slow, run)] == ["PASS", "FAIL", "PASS"]


@pytest.mark.parametrize("name", ["zone", "lights", "station", "speed", "pose"])
def test_states_cannot_be_written_to(run: Run, name: str) -> None:
    array = getattr(run, name)
    with pytest.raises(ValueError, match=r"read-only|output array"):
        array *= 2


@pytest.mark.parametrize("name", ["here", "spans"])
def test_derived_arrays_are_read_only(run: Run, name: str) -> None:
    with pytest.raises(ValueError, match=r"read-only|output array"):
        getattr(run, name)[0] += 1


def test_results_of_a_run_live_as_long_as_the_run_and_are_in_no_copy(run: Run) -> None:
    works: list[Run] = []

    def work(of: Run) -> int:
        works.append(of)
        return len(works)

    copies = replace(run), pickle.loads(pickle.dumps(run))
    assert [once(run, work), once(run, work)] == [1, 1]
    assert [once(copy, work) for copy in (*copies, replace(run), pickle.loads(pickle.dumps(run)))] == [2, 3, 4, 5]


def test_a_simulated_run_is_a_value_too() -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", distance=10, duration=20, subject=0), Reference, traffic=Reference))
    assert run.facts == Facts(subject="a0", speed_limit=11.176)
    assert run.agents[0].size == (4.6, 1.86)
    assert run.subject == "a0"
    speed = run.speed
    assert speed is not None
    with pytest.raises(ValueError, match="read-only"):
        speed[0] = 1.0
    assert check(run, "full_stop").status == "PASS"


def test_run_copies_writable_arrays(run: Run) -> None:
    zone = np.zeros((200, 2), dtype=np.int8)
    shown = zone.view()
    for given, writeable in ((zone, True), (shown, False), (zone, False)):
        given.flags.writeable = writeable
        mine = replace(run, zone=given)
        before = mine.hash
        zone.flags.writeable = True
        zone[0] = 1
        assert not mine.zone.any(), "the run has states of its own"
        assert replace(mine).hash == before
        zone[0] = 0


def test_where_a_run_comes_from_cannot_be_written_to(run: Run) -> None:
    told: dict[str, Any] = {"end": "left", "vehicle": {"mass": 1500.0}}
    mine = replace(run, provenance=told)
    told["end"] = "route"
    assert mine.provenance == {"end": "left", "vehicle": {"mass": 1500.0}}
    with pytest.raises(TypeError, match="does not support item assignment"):
        mine.provenance["end"] = "route"  # type: ignore[index]


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"subject": 3}, "subject of facts: it must be a text or null, got 3"),
        ({"speed_limit": "x"}, "speed_limit of facts: it must be a number or null, got 'x'"),
        ({"speed_limit": -3}, "speed_limit of facts: it must be a number > 0.0, got -3"),
        ({"speed_limit": float("nan")}, "speed_limit of facts"),
        ({"speed_limit": float("inf")}, "speed_limit of facts"),
        ({"strayed": 5}, "strayed of facts: it must be a list, got 5"),
        ({"strayed": "a0"}, "strayed of facts: it must be a list, got 'a0'"),
        ({"strayed": (1,)}, r"strayed of facts: the field '\[0\]' must be a text, got 1"),
    ],
)
def test_facts_that_a_run_file_would_refuse_are_refused_at_once(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(RunError, match=says):
        Facts(**wrong)


def test_facts_are_kept_as_the_file_keeps_them(run: Run, tmp_path: Path) -> None:
    facts = Facts(speed_limit=np.float64(8), strayed=["a0"])  # type: ignore[arg-type]
    assert facts == Facts(None, 8.0, ("a0",))
    whole = replace(run, facts=Facts(speed_limit=8), provenance={"vehicle": {"mass": 1500.0}})
    save_run(whole, tmp_path / "run.npz")
    again = load_run(tmp_path / "run.npz")
    assert (again.hash, again.provenance) == (whole.hash, whole.provenance)


def test_a_run_survives_a_pickle(run: Run) -> None:
    again = pickle.loads(pickle.dumps(run))
    assert again == run
    assert again.junction.digest == run.junction.digest
    assert not again.zone.flags.writeable
    assert check(again, "speed_limit").message == check(run, "speed_limit").message


def test_tables_of_a_junction_cannot_be_written_to() -> None:
    with pytest.raises(TypeError, match="does not support item assignment"):
        find("stop4").movements[0, 1] = None  # type: ignore[index]


def test_missing_quantity_is_named_in_the_error(run: Run) -> None:
    bare = replace(run, station=None, speed=None, pose=None, agents=tuple(replace(a, size=None) for a in run.agents))
    for name, what in (("station", "positions"), ("pose", "positions"), ("speed", "speeds")):
        with pytest.raises(RunError, match=f"the run holds no {what}"):
            bare.need(name)
    with pytest.raises(RunError, match="no size of its vehicles"):
        bare.size(0)
    assert run.size(1) == (4.6, 1.86)
