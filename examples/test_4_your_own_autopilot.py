"""Your own autopilot in ten lines: inherit the helper that steers along the itinerary, and decide a target speed.

A controller of your own from the ground up is any class with ``control(self, seen) -> rvads.Control``.
"""

import pytest

import pytest_rvads as rvads


class ByNumber(rvads.Follower):
    """Lets those at lower entrances go first, and waits while somebody is in the junction."""

    def target_speed(self, seen: rvads.Observation) -> float:
        """Return the speed to drive at [m/s]."""
        occupied = any(other.zone == rvads.Zone.JUNCTION for other in seen.others)
        yields = any(other.zone <= rvads.Zone.ENTRANCE and other.entrance < seen.me.entrance for other in seen.others)
        if seen.me.zone >= rvads.Zone.JUNCTION or not (occupied or yields):
            return seen.speed_limit
        return self.stopping_speed(seen.itinerary.line - 0.5 - seen.me.station)


@pytest.fixture
def rvads_autopilot():
    """Return the system under test; a fixture in conftest.py would serve all test files."""
    return ByNumber


@rvads.scenario("stop4", classes=(1, 7, 24), distances=[5, 20], speeds=[0, 4], rules="p1")
def test_one_at_a_time(run, rule, monitor):
    assert monitor.check(rule)


@rvads.known("queue", reason="goes by the number of the entrance, not by who came first")
@rvads.scenario("stop4", classes=(1, 7, 24), distances=(20, 20, 0.3, 0.3), rules="p3")
def test_first_come_first_served(run, rule, monitor):
    monitor.check(rule)
