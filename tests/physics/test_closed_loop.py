"""v(d)max of an autopilot: never more than the plant's, and what it loses is its own."""

from functools import partial

import pytest

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.physics.braking import greatest_safe, vmax
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.simulators.driver_dynamics import closed_vmax
from pytest_rvads.support.errors import RunError, ScenarioError


def test_deficiency_i1_has_no_safe_speed_at_one_centimetre() -> None:
    assert closed_vmax(0.01, LgsvlLike) is None
    without = closed_vmax(0.01, partial(LgsvlLike, i1=False))
    assert without is not None
    assert 0.0 <= without <= vmax(0.01)


@pytest.mark.extended
def test_a_lazy_brake_reaches_what_its_deceleration_allows() -> None:
    class Lazy(Follower):
        """Half the service brake from the start, whatever comes."""

        def control(self, seen: Observation) -> Control:
            return Control(0.0, 0.5, self.steer(seen))

    # Full brake at aggression 1 is 4 m/s^2; half of it at aggression 2 (6 m/s^2) is 3 m/s^2, and so on.
    for level, full in ((1, 4.0), (3, 8.0)):
        found = closed_vmax(8.0, Lazy, level)
        # v = sqrt(2 a d) with a tenth of a second of lag and some resistance.
        assert found == pytest.approx((2 * 0.5 * full * 8.0) ** 0.5, rel=0.08)
        assert found < vmax(8.0, level)


@pytest.mark.extended
def test_the_reference_stays_below_the_plant() -> None:
    for distance in (0.3, 5.0):
        limit, found = vmax(distance), closed_vmax(distance, Reference)
        assert limit is not None
        assert found is not None
        assert 0.9 * limit <= found <= limit


@pytest.mark.extended
@pytest.mark.parametrize(("junction", "movement"), [("light4", (0, 2)), ("light4", (1, 0)), ("stop4", (0, 1)), ("stop4", (2, 1))])
def test_every_movement_has_its_own(junction: str, movement: tuple[int, int]) -> None:
    found, limit = closed_vmax(5.0, Reference, place=find(junction), movement=movement), vmax(5.0)
    assert 0.9 * limit <= found <= limit, "entrance 0 has red, too, and who turns right on red has stopped before"


def test_rolling_driver_has_no_closed_loop_speed_at_a_stop_sign() -> None:
    class Rolls(Follower):
        """Never below walking pace."""

        def target_speed(self, seen: Observation) -> float:
            return 2.0

    assert closed_vmax(5.0, Rolls, place=find("stop4"), movement=(0, 2)) == 0.0, "it stood at the start, and never again"
    with pytest.raises(ScenarioError, match=r"junction 'stop4' has no movement \(0, 0\): name entrance and exit of one of"):
        closed_vmax(5.0, Rolls, place=find("stop4"), movement=(0, 0))


def test_an_autopilot_that_fails_at_low_speeds_alone_is_not_called_safe() -> None:
    assert greatest_safe(lambda v: not 2.0 < v < 4.0, 10.0) == 10.0, "one probe is enough where safety is monotone"
    assert greatest_safe(lambda v: not 2.0 < v < 4.0, 10.0, probes=8) == 2.0
    assert greatest_safe(lambda v: v <= 3.14159, 10.0, probes=8) == 3.14
    assert greatest_safe(lambda v: True, 0.16, probes=8) == 0.16
    assert greatest_safe(lambda v: False, 10.0, probes=8) is None


def test_faults_and_distances_off_the_road_are_told() -> None:
    class Broken(Follower):
        def control(self, seen: Observation) -> Control:
            raise ValueError("no idea")

    with pytest.raises(RunError, match=r"no v\(d\)max at 5 m: .*Broken driving a1 raised ValueError"):
        closed_vmax(5.0, Broken)
    with pytest.raises(ScenarioError, match="does not fit"):
        closed_vmax(5000.0, Reference)
