"""The paper's two tables, cell by cell: the LGSVL-like autopilot, and the deficiency behind every failing cell.

``rvads paper`` prints the same as tables. The autopilot is a calibrated surrogate (docs/replication.md); one draw, `WAIT`,
serves all runs. A cell marked with ``known`` has to fail: should the deficiency be repaired, its test would tell. Try it
with ``partial(LgsvlLike, i3=False)``, which no longer ignores who comes from the right.
"""

import pytest

import pytest_rvads as rvads
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.satellites.paper.tables import WAIT


@pytest.fixture(scope="session")
def rvads_autopilot():
    return LgsvlLike


@rvads.known("I1", cfg="A", rule=("p1", "p2"), reason="drives off before it knows that it has to stop")
@rvads.known("I2", cfg="B", rule="p1", reason="the scheduler's zone is smaller than the junction")
@rvads.known("I2", cfg=("C", "D", "E"), rotation=(0, 1, 3), rule="p1", reason="the zone ends early at exits 2 and 3")
@rvads.known("I3", cfg=("B", "C", "D", "E"), rule="p2", reason="creation order decides, not who is to the right")
@rvads.scenario("paper_stop4", scenarios=("2111", "3111"), grid="paper", cover="rotation", duration=30.0, wait=WAIT)
def test_stop(run, rule, monitor):
    monitor.check(rule)


@rvads.known("I1", cls=13, cfg="F", rule=("p4", "p6"), reason="drives off before it knows that it has to stop")
@rvads.known("I5", cls=13, cfg=("G", "H", "I", "J"), rule="p6", reason="turning left it does not yield to a right turn")
@rvads.known("I4", cls=8, cfg="J", rule="p5", reason="turns right on red after a time, without looking")
@rvads.scenario("paper_light4", scenarios=("1233", "2121"), grid="paper", cover="rotation", duration=40.0, wait=WAIT)
def test_light(run, rule, monitor):
    monitor.check(rule)
