"""The first difference between two runs, against arrays changed by hand."""

from dataclasses import replace

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.runs.run import Collision, Run, diverge


@pytest.fixture(scope="module")
def run() -> Run:
    return rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "1133", distance=0.3, duration=2.0), rvads.Reference))


def changed(run: Run, field: str, *index: int, value: float) -> Run:
    values = getattr(run, field).copy()
    values[index] = value
    return replace(run, **{field: values})


def test_equal_runs_do_not_part(run: Run) -> None:
    again = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "1133", distance=0.3, duration=2.0), rvads.Reference))
    assert diverge(run, again) is None
    assert run == again
    assert len({run, again}) == 1


def test_the_first_state_and_field_are_named(run: Run) -> None:
    later = changed(run, "speed", 90, 1, value=7.5)
    found = diverge(run, changed(later, "pose", 120, 3, 2, value=1.0))
    assert found is not None
    assert (found.tick, found.time, found.what, found.other) == (90, 0.9, "speed of a1", "7.5")
    assert str(found).startswith("t=0.90 s (tick 90): speed of a1 is ")
    turned = diverge(run, changed(run, "pose", 120, 3, 2, value=1.0))
    assert turned is not None
    assert (turned.tick, turned.what) == (120, "heading of a3")
    assert later != run


def test_words_for_zones_and_lights(run: Run) -> None:
    zone = diverge(run, changed(run, "zone", 5, 0, value=rvads.Zone.EXIT))
    light = diverge(run, changed(run, "lights", 5, 2, value=3))
    assert zone is not None
    assert light is not None
    assert (zone.what, zone.other) == ("zone of a0", "exit")
    assert (light.what, light.one, light.other) == ("light of entrance 2", "none", "red")


def test_bits_count_as_the_hash_counts_them(run: Run) -> None:
    # 0.0 == -0.0 and NaN != NaN as numbers; as bits it is the other way round.
    zero, minus = changed(run, "speed", 0, 0, value=0.0), changed(run, "speed", 0, 0, value=-0.0)
    assert (diverge(zero, minus) is None) == (zero.hash == minus.hash) is False
    nan = changed(run, "speed", 0, 0, value=np.nan)
    assert diverge(nan, changed(run, "speed", 0, 0, value=np.nan)) is None


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"label": "other"}, "label"),
        ({"dt": 0.02}, "step"),
        ({"speed": None}, "speed"),
        ({"collisions": (Collision(1.0, ("a0", "a1"), 2.0),)}, "collisions"),
    ],
)
def test_difference_outside_of_the_states_has_no_tick(run: Run, change: dict[str, object], what: str) -> None:
    found = diverge(run, replace(run, **change))  # type: ignore[arg-type]
    assert found is not None
    assert (found.what, found.tick) == (what, None)


def test_longer_run_differs_in_length(run: Run) -> None:
    zone, lights = (np.concatenate([states, states[-1:]]) for states in (run.zone, run.lights))
    longer = replace(run, zone=zone, lights=lights)
    shorter = replace(run, station=None, speed=None, pose=None, controls=None)
    longer = replace(longer, station=None, speed=None, pose=None, controls=None)
    found = diverge(shorter, longer)
    assert found is not None
    assert (found.what, found.one, found.other) == ("length", str(run.steps), str(run.steps + 1))
    assert run != "a run"
