"""Your own autopilot in ten lines: inherit the helper that steers along the itinerary, and decide a target speed.

A controller of your own from the ground up is any class with ``control(self, seen) -> rvads.Control``.
"""

import pytest

import pytest_rvads as rvads


class Patient(rvads.Follower):
    """Stops at the line, then goes when its turn has come by the number of its entrance."""

    def target_speed(self, seen: rvads.Observation) -> float:
        line = seen.itinerary.line
        if seen.me.station > 0 or seen.time > 8.0 + 9.0 * seen.me.entrance:
            return 6.0
        return self.speed_to_stop(seen, line - 0.5 - seen.me.station)


@pytest.fixture
def rvads_autopilot():
    return Patient


@rvads.scenario("stop4", classes=(1, 7, 24), distances=[5, 20], speeds=[0, 4], rules="p1")
def test_one_at_a_time(run, rule, monitor):
    assert monitor.check(rule)
