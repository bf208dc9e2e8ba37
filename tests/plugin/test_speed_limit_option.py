"""``--rvads-speed-limit`` takes the place of what maps and recordings state."""

import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.finder import find

pytest_plugins = ["pytester"]

TEST = """
import pytest_rvads as rvads

@rvads.scenario("stop4", scenarios="2000", distances=20, rules="speed_limit", duration=8)
def test_drives(run, monitor, rule):
    monitor.check(rule)
    assert run.junction.top_limit == {limit!r}
    assert max(run.need("speed")[:, 0]) < {limit!r} + 0.5

@rvads.recorded("run.npz", rules="speed_limit")
def test_recorded(monitor, rule):
    monitor.check(rule)
"""


@pytest.mark.extended
@pytest.mark.parametrize(
    ("arguments", "ini", "limit", "recorded"),
    [
        (["--rvads-speed-limit=18km/h"], "", 5.0, "FAIL"),
        (["--rvads-speed-limit=18km/h"], "[pytest]\nrvads_speed_limit = 3mph", 5.0, "FAIL"),
        ([], "[pytest]\nrvads_speed_limit = 5", 5.0, "FAIL"),
        ([], "", 11.176, "PASS"),
    ],
)
def test_the_limit_of_the_session_holds_everywhere(
    pytester: pytest.Pytester, arguments: list[str], ini: str, limit: float, recorded: str
) -> None:
    scenario = rvads.Scenario(find("stop4").limited(8.0), "2000", distance=20, speed=7.0, duration=1)
    rvads.files.save_run(rvads.simulate(rvads.Case(scenario, rvads.Reference)), pytester.path / "run.npz")
    pytester.makepyfile(TEST.replace("{limit!r}", repr(limit)))
    pytester.makefile(".ini", pytest=ini or "[pytest]")
    pytester.runpytest(*arguments).assert_outcomes(passed=1 if recorded == "FAIL" else 2, failed=int(recorded == "FAIL"))


@pytest.mark.extended
@pytest.mark.parametrize(("arguments", "outcome"), [(["--rvads-speed-limit=18km/h"], "failed"), ([], "passed")])
def test_a_search_goes_by_the_limit_of_the_session(pytester: pytest.Pytester, arguments: list[str], outcome: str) -> None:
    pytester.makepyfile("""
        import pytest_rvads as rvads

        class Cruiser(rvads.Follower):
            def target_speed(self, seen):
                return 8.0

        @rvads.falsify("stop4", rule="speed_limit", autopilot=Cruiser, budget=5, far=20.0, duration=8)
        def test_search(): ...
    """)
    result = pytester.runpytest("-p", "no:cacheprovider", *arguments)
    result.assert_outcomes(**{outcome: 1})
    if outcome == "failed":
        result.stdout.fnmatch_lines(["E*RuleViolation: speed_limit at t=*"])


def test_invalid_speed_limit_is_refused_with_an_example(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TEST)
    result = pytester.runpytest("--rvads-speed-limit=fast")
    message = "rvads_speed_limit must be a speed above 0 such as 30mph, 50km/h or, in m/s, 13.9, got 'fast'"
    result.stderr.fnmatch_lines([f"*{message}*"])
