"""Sessions of pytest in which SUMO simulates."""

from pathlib import Path

import pytest

from pytest_rvads.satellites.sumo import sumo_simulator
from pytest_rvads.simulators import simulator as choosing
from pytest_rvads.simulators.loop import usual
from tests.inner_sessions import records_of

from .with_sumo import needs_sumo

pytestmark = needs_sumo

EXAMPLE = Path(__file__).parents[3] / "examples" / "test_1_all_way_stop.py"
AMONG = """
    import pytest_rvads as rvads

    RULES = ("full_stop", "no_collision")

    @rvads.scenario("stop4", subject=0, traffic=("reference", "sumo"), grid="C", scenarios="2200", rules=RULES)
    def test_among(rule, monitor):
        monitor.check(rule)
"""
SUMO = "--rvads-simulator=sumo"


def test_example_runs_in_sumo_with_its_driver(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_1=EXAMPLE.read_text(encoding="utf-8"))
    result = pytester.runpytest(SUMO, "--rvads-autopilot=sumo", "-k", "class01 and cfgC", "--rvads-report=report.json", "-vv")
    result.stdout.fnmatch_lines(
        [
            "rvads: driven by --rvads-autopilot=sumo (pytest-rvads *)",
            "rvads: simulated by --rvads-simulator=sumo (pytest-rvads *)",
            "rvads: SUMO's driver drives only where it is named (--rvads-autopilot sumo, traffic='sumo'); its vehicles have no *",
            "*p1 at t=* both in junction*",
        ]
    )
    assert "SUMO's driver drives only" not in result.stdout.str().partition("collected")[2], "said once"
    outcomes = result.parseoutcomes()
    assert outcomes["failed"] >= 2
    assert "errors" not in outcomes
    report = (pytester.path / "report.json").read_text(encoding="utf-8")
    assert '"simulator": "sumo"' in report or '"simulator":"sumo"' in report


def test_ids_name_sumo_as_the_traffic_around_another_driver(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(AMONG)
    result = pytester.runpytest(SUMO, "--rvads-autopilot=reference", "-v")
    result.assert_outcomes(passed=4)
    result.stdout.fnmatch_lines(["*test_among?stop4-class00-as2200-s0-cfgC-sumo-full_stop? PASSED*"])


def test_records_name_the_simulator(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(AMONG)
    result = pytester.runpytest(SUMO, "--rvads-autopilot=reference", "--rvads-report=report.json")
    result.stdout.fnmatch_lines([f"simulated by {usual().name} (*): 1 run", "simulated by sumo (libsumo *): 1 run"])
    records = records_of(pytester.path, "report.json")
    assert {(r["traffic"], r["simulator"]) for r in records} == {("reference", usual().name), ("sumo", "sumo")}


def test_session_without_runs_names_no_simulator(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makeconftest("""
        import pytest
        import pytest_rvads as rvads

        @pytest.fixture(scope="session")
        def rvads_simulator():
            return rvads.sumo
    """)
    pytester.makepyfile(AMONG)
    monkeypatch.setattr(sumo_simulator, "find_spec", lambda _name: None)
    result = pytester.runpytest("--rvads-autopilot=reference")
    assert result.parseoutcomes() == {"errors": 4}
    result.stdout.no_fnmatch_line("*simulated by*")


def test_sumo_driver_in_another_simulator_is_an_error(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(AMONG)
    result = pytester.runpytest("--rvads-autopilot=reference", "-k", "cfgC-sumo")
    assert result.ret == 1
    result.stdout.fnmatch_lines(["*SUMO's driver drives in the simulator sumo alone*add --rvads-simulator sumo*"])
    assert result.parseoutcomes() == {"errors": 2, "deselected": 2}


def test_missing_libsumo_ends_the_session_before_any_run(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(AMONG)
    monkeypatch.setattr(choosing, "find_spec", lambda _name: None)
    result = pytester.runpytest(SUMO)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    says = "ERROR: simulator 'sumo' needs the package libsumo, which is not installed: pip install 'pytest-rvads?sumo?'"
    result.stderr.fnmatch_lines([says])


def test_custom_simulator_may_state_a_caveat(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        own="""
        from pytest_rvads.simulators.loop import usual

        class Own:
            name = "own"
            caveat = "its tyres are square"
            vmax = staticmethod(usual().vmax)

            def __call__(self, case, watch=None):
                return usual()(case, watch)

        own = Own()
        """,
        test_one="def test_nothing():\n    pass",
    )
    result = pytester.runpytest("--rvads-simulator=own:own")
    result.stdout.fnmatch_lines(["rvads: simulated by --rvads-simulator=own:own (own.py *)", "rvads: its tyres are square"])
