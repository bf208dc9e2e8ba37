"""``rvads dynamics pedals``: what the pedals of a driver do, held against the parameters of the simulated vehicle."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.simulators.driver_dynamics import calibrated

FULL_DRIVE, FULL_BRAKE = 3.0, (4.0, 6.0, 8.0)
"""Acceleration at full throttle and deceleration at full brake by aggression of a usual car, as `Vehicle` documents [m/s^2]."""


class Pedals(rvads.Follower):
    """Presses the throttle to 0.6 up to 8 m/s; brakes with 0.25 from 20 m before a red light on, and holds."""

    def control(self, seen: rvads.Observation) -> rvads.Control:
        steering = self.steer(seen)
        red = seen.lights[seen.me.entrance] == rvads.Colour.RED and -20.0 < seen.me.station <= 0.0
        if red:
            return rvads.Control(brake=0.25, steering=steering)
        return rvads.Control(throttle=0.6 if seen.me.speed < 8.0 else 0.0, steering=steering)


class Coasting(rvads.Follower):
    def control(self, seen: rvads.Observation) -> rvads.Control:
        return rvads.Control(steering=self.steer(seen))


@pytest.mark.parametrize("aggression", [1, 3])
def test_full_pedals_are_those_of_the_vehicle(aggression: int) -> None:
    throttle, brake = calibrated(Pedals, aggression=aggression)
    assert throttle.full == pytest.approx(FULL_DRIVE, rel=0.01)
    assert brake.full == pytest.approx(-FULL_BRAKE[aggression - 1], rel=0.01)
    assert (throttle.largest, brake.largest) == (pytest.approx(0.6, abs=0.001), pytest.approx(0.25, abs=0.001))
    for used in throttle.used:
        assert used.acceleration == pytest.approx(FULL_DRIVE * used.position, rel=0.02)


def test_pedal_that_is_never_pressed_has_no_full_acceleration() -> None:
    for pedal in calibrated(Coasting):
        assert pedal == (None, 0.0, ())


def test_calibration_is_a_table_json_and_a_drawing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(
        "import pytest_rvads as rvads\n"
        "class Brakes(rvads.Follower):\n"
        "    def control(self, seen):\n"
        "        return rvads.Control(0.0, 0.5, self.steer(seen))\n"
    )
    assert main(["dynamics", "pedals", "--autopilot", "mine:Brakes", "--json", "--aggression", "2", "--svg", "pedals.svg"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["version"], result["aggression"]) == (1, 2)
    assert result["throttle"] == {"full": None, "largest": 0.0, "used": []}
    assert result["brake"]["full"] == pytest.approx(-FULL_BRAKE[1], rel=0.01)
    words = [element.text for element in ElementTree.parse("pedals.svg").iter() if element.text]
    assert {"pedals of mine:Brakes", "position of the throttle, 1 = full", "position of the brake, 1 = full"} <= set(words)
    assert main(["dynamics", "pedals", "--autopilot", "mine:Brakes"]) == 0
    *_, throttle, brake = capsys.readouterr().out.splitlines()
    assert throttle == "throttle: never pressed"
    assert brake == "brake: -4.00 m/s^2 at full pedal, pressed up to 0.50"


def test_calibration_of_a_failing_driver_is_one_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("theirs.py").write_text("class Late:\n    def control(self, seen):\n        raise KeyError('plan')\n")
    assert main(["dynamics", "pedals", "--autopilot", "theirs:Late"]) == 2
    assert "no calibration: Late driving a0 raised KeyError: 'plan'" in capsys.readouterr().err
    assert main(["dynamics", "pedals"]) == 2
    assert "no driver is named" in capsys.readouterr().err
