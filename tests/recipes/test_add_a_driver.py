"""CONTRIBUTING.md, "Add a driver or traffic policy": done from outside, as it says."""

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.reference import Gate
from pytest_rvads.drivers.traffic import POLICIES, Policy, traffic


class Sleepy(rvads.Reference):
    """Obeys every rule, but sets off two seconds late."""

    def make_gate(self, seen: rvads.Observation) -> Gate:
        return Late(super().make_gate(seen))


class Late:
    def __init__(self, gate: Gate) -> None:
        self.gate = gate
        self.since: float | None = None

    def allows(self, seen: rvads.Observation) -> bool:
        if not self.gate.allows(seen):
            return False
        self.since = seen.time if self.since is None else self.since
        return seen.time - self.since >= 2.0


def test_a_policy_is_a_class_and_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(POLICIES, "sleepy", Sleepy)
    assert Policy.of("sleepy").factory is traffic("sleepy") is Sleepy
    run = rvads.simulate(
        rvads.Case(
            rvads.Scenario(rvads.find("stop4"), "2200", distance=20, subject=0), rvads.Reference, traffic=traffic("sleepy")
        )
    )
    assert run.fault is None
    assert rvads.check(run, "full_stop").status == "PASS"


def test_from_outside_a_class_is_enough(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        class Crawler:
            def control(self, seen):
                return rvads.TargetSpeed(1.0)

        @rvads.scenario("stop4", subject=0, traffic=Crawler, grid="C", scenarios="2200", rules="speed_limit", duration=20)
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """
    )
    pytester.runpytest("--rvads-autopilot=reference").assert_outcomes(passed=1)
