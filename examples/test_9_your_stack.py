"""A stack in another process, one vehicle among traffic: the example of the Python client, as ``rvads_client`` has it.

For a stack of your own this file is not needed: ``pytest --rvads-sut "python my_stack.py"``.
"""

import sys
from pathlib import Path

import pytest

import pytest_rvads as rvads

STACK = Path(__file__).parents[1] / "clients" / "python" / "example.py"


@pytest.fixture(scope="session")
def rvads_autopilot():
    """Return the stack; one process serves all runs."""
    with rvads.Process([sys.executable, str(STACK)], timeout=10.0) as stack:
        yield stack


@rvads.scenario("stop3", subject="all", grid="E")
def test_all_way_stop(run, rule, monitor):
    monitor.check(rule)


@rvads.scenario("light4", subject=1, scenarios=("2222", "1232"), grid="I", traffic=("reference", "red_light_runner"))
def test_lights(run, rule, monitor):
    monitor.check(rule)
