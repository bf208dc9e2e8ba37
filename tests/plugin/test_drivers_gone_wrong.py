"""Drivers that hang or do what no driver should: each costs its own items, as ERRORs that name it, and nobody else's."""

import xml.etree.ElementTree as ET
from typing import Any

import pytest

from pytest_rvads.session import items
from tests.inner_sessions import driven_by, records_of

SESSION = """
    import asyncio, collections, itertools, time
    import pytest
    import pytest_rvads as rvads

    class Odd(rvads.Reference):
        def control(self, seen):
            if seen.time > 0.05:
                {does}
            return super().control(seen)

    class TestOdd:
        rvads_autopilot = pytest.fixture(lambda self: Odd)

        @rvads.scenario("stop4", classes={classes}, grid="C", rules="p1", duration=2)
        def test_it(self, rule, monitor):
            monitor.check(rule)

    class TestSound:
        rvads_autopilot = pytest.fixture(lambda self: rvads.Reference)

        @rvads.scenario("stop4", classes=(1, 2), grid="C", duration=2)
        def test_it(self, run):
            assert run.duration == 2
"""


def session(pytester: pytest.Pytester, does: str, *options: str, classes: tuple[int, ...] = (1,)) -> list[dict[str, Any]]:
    """Run a session and return its records, those of the odd driver first."""
    pytester.makepyfile(test_it=SESSION.format(does=does, classes=classes))
    pytester.runpytest("-p", "no:cacheprovider", "--rvads-report=out.json", *options)
    records: list[dict[str, Any]] = records_of(pytester.path)
    return sorted(records, key=lambda record: "TestOdd" not in record["nodeid"])


@pytest.mark.extended
def test_after_three_runs_that_were_too_late_a_driver_is_not_asked_again(pytester: pytest.Pytester) -> None:
    *odd, one, two = session(pytester, "time.sleep(600)", "--rvads-decision-limit=0.4", classes=(1, 2, 3, 4, 5))
    assert [record["status"] for record in odd] == ["ERROR"] * 5
    says = "Odd driving a0 at 0.06 s: no answer within 0.4 s of real time (setting rvads_decision_limit), it was at test_it.py:8"
    assert [record["message"] for record in odd[:3]] == [f"ERROR: {says}"] * 3
    assert {record["message"] for record in odd[3:]} == {
        "test_it.Odd is not asked again: 3 runs in a row were too late, the last one because of this: " + says
    }
    assert (one["status"], two["status"]) == ("PASS", "PASS")


@pytest.mark.extended
@pytest.mark.parametrize(
    "does",
    [
        pytest.param(
            "while True:\n                    try: time.sleep(1)\n                    except BaseException: pass", id="catches"
        ),
        pytest.param("collections.deque(itertools.repeat(0), maxlen=0)", id="in C", marks=pytest.mark.slow),
    ],
)
def test_unstoppable_driver_costs_its_worker_and_its_item(pytester: pytest.Pytester, does: str) -> None:
    odd, one, two = session(pytester, does, "--rvads-decision-limit=0.4", "-n1")
    assert (odd["status"], odd["outcome"]) == ("ERROR", "failed")
    assert "the worker process crashed" in odd["message"]
    assert (one["status"], two["status"]) == ("PASS", "PASS")


def test_pytests_own_timer_is_left_alone(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        from pytest_rvads.simulators.patience import NEVER

        def test_it(rvads_simulator):
            assert rvads_simulator.limits == (15.0, 7.0, NEVER)
    """)
    result = pytester.runpytest("-o", "faulthandler_timeout=100", "--rvads-run-limit=7", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=1)


@pytest.mark.parametrize(
    "does",
    [
        "pytest.skip('not today')",
        "pytest.xfail('known')",
        "pytest.exit('the end', 0)",
        "raise asyncio.CancelledError",
        "raise SystemExit(0)",
        "raise ValueError('\\x1b[2J\\u202e\\ud800\\x00' * 1000)",
        "return rvads.Control(10**400)",
    ],
)
def test_driver_error_stays_within_its_items(pytester: pytest.Pytester, does: str) -> None:
    odd, one, two = session(pytester, does, "--junitxml=out.xml")
    assert (odd["status"], odd["outcome"]) == ("ERROR", "failed")
    assert "Odd driving a0" in odd["message"]
    assert "at 0.06 s" in odd["message"]
    assert (one["status"], two["status"]) == ("PASS", "PASS")
    assert len(ET.parse(pytester.path / "out.xml").findall(".//testcase")) == 3


def test_what_a_driver_calls_itself_and_measures_spoils_no_report(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(r"""
        import pytest
        import pytest_rvads as rvads

        class Odd(rvads.Reference):
            label = "\x1b[31m\x00\u202e<b>" + "x" * 1_000_000

            def timing(self):
                return {"planner_ms": 1.5}

        class Nonsense(Odd):
            def timing(self):
                return object()

        class Complete(Odd):
            def timing(self):
                return {"stack": "\x1b[2J", "decisions": 1, "compute": 0.5, "longest": 0.5}

        @pytest.fixture(params=[Odd, Nonsense, Complete])
        def rvads_autopilot(request):
            return request.param

        @rvads.scenario("stop4", classes=1, grid="C", duration=1)
        def test_it(run):
            pass
    """)
    files = ("out.json", "out.html", "out.md", "out.csv")
    options = [f"--rvads-report={name}" for name in files]
    result = pytester.runpytest("-p", "no:cacheprovider", "--junitxml=out.xml", *options)
    result.assert_outcomes(passed=3)
    assert result.ret == 0
    records = records_of(pytester.path)
    assert [told["a0"]["stack"] for r in records if (told := r.get("timing"))] == [r"\x1b[2J"]
    assert all(r["driver"].isprintable() and len(r["driver"]) < 5000 for r in records)
    ET.parse(pytester.path / "out.xml")


FAILS = """
    import pytest
    import pytest_rvads as rvads

    made = []

    class Changes(rvads.Reference):
        def __init__(self):
            super().__init__()
            made.append(self)

        def control(self, seen):
            if len(made) > 4:  # the run is simulated once more
                {does}
            return super().control(seen)

    @pytest.fixture
    def rvads_autopilot():
        return Changes

    @rvads.scenario("stop4", classes=7, grid="C", duration=1)
    def test_it(run):
        assert run is None

    @rvads.scenario("stop4", classes=7, grid="C", duration=1)
    def test_other(run):
        pass
"""


@pytest.mark.extended
@pytest.mark.parametrize("does", ["return rvads.Control(10**400)", "raise SystemExit", "import time; time.sleep(600)"])
def test_what_comes_of_the_second_run_of_a_failed_item_costs_no_other_verdict(pytester: pytest.Pytester, does: str) -> None:
    pytester.makepyfile(FAILS.format(does=does))
    options = ("-p", "no:cacheprovider", "--rvads-report=out.json", "--rvads-decision-limit=0.4")
    result = pytester.runpytest(*options)
    result.assert_outcomes(failed=1, errors=1)
    records = records_of(pytester.path)
    assert [record["status"] for record in records] == ["FLAKY", "ERROR"]


def test_a_diagnosis_that_fails_costs_no_more_than_itself(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise SystemExit("no diagnosis")

    monkeypatch.setattr(items, "_explanation", broken)
    monkeypatch.setattr(items, "_with_repetition", broken)
    tests = """
        @rvads.scenario("stop4", classes=(1, 7), grid="B", rules="p1", duration=4)
        def test_it(rule, monitor):
            monitor.check(rule)
    """
    pytester.makepyfile(driven_by("Racer", tests))
    result = pytester.runpytest("-p", "no:cacheprovider")
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines(["*the explanation is incomplete, because of SystemExit: no diagnosis*"])


def test_failed_run_is_simulated_once_for_all_rules(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest
        import pytest_rvads as rvads

        class Breaks:
            name = "breaks"
            asked = 0

            def __call__(self, case, watch=None):
                Breaks.asked += 1
                if "as1111" in case.scenario.name:
                    raise OSError("no licence")
                pytest.skip("not today")

            def vmax(self, distance, aggression=1, vehicle=None):
                return None

        @pytest.fixture
        def rvads_simulator():
            return Breaks()

        @rvads.scenario("stop4", classes=(1, 2), grid="C", rules=("p1", "p2", "p3"))
        def test_it(rule, monitor):
            monitor.check(rule)

        def test_asked_once_for_every_run():
            assert Breaks.asked == 2
    """)
    options = ("-p", "no:cacheprovider", "--rvads-autopilot=reference", "--rvads-report=out.json")
    pytester.runpytest(*options).assert_outcomes(errors=6, passed=1)
    records = records_of(pytester.path)
    place = "test_failed_run_is_simulated_once_for_all_rules.py:11"
    said = {f"OSError: no licence ({place})", "simulating raised Skipped: not today"}
    assert {record["message"] for record in records} == said


def test_an_item_that_is_over_holds_no_run(pytester: pytest.Pytester) -> None:
    pytester.makeconftest("""
        from pytest_rvads.session.items import RECORD, RUN, VERDICTS

        def pytest_sessionfinish(session):
            print("held:", [len(item.stash._storage) for item in session.items if RECORD in item.stash or RUN in item.stash])
    """)
    pytester.makepyfile("""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=(1, 7), grid="B", rules="p1", duration=4)
        def test_it(rule, monitor):
            monitor.check(rule)
    """)
    result = pytester.runpytest("-p", "no:cacheprovider", "--rvads-autopilot=reference", "-s")
    result.stdout.fnmatch_lines(["*held: []*"])


@pytest.mark.extended
@pytest.mark.parametrize("name", ["label", "__qualname__", "autopilots", "control", "period"])
@pytest.mark.parametrize("does", ["pytest.skip('not today')", "sys.exit(0)", "time.sleep(600)"])
def test_raising_attribute_is_an_error_of_the_driver(pytester: pytest.Pytester, name: str, does: str) -> None:
    pytester.makepyfile(f"""
        import sys, time
        import pytest
        import pytest_rvads as rvads

        class Odd:
            def __getattribute__(self, name):
                if name == "{name}":
                    {does}
                return object.__getattribute__(self, name)

            def control(self, seen):
                return rvads.Control()

        class Maker(Odd):
            def __call__(self):
                return Odd()

        class TestOdd:
            rvads_autopilot = pytest.fixture(lambda self: Maker())

            @rvads.scenario("stop4", classes=1, grid="C", rules=("p1", "p2"), duration=1)
            def test_it(self, rule, monitor):
                monitor.check(rule)

        class TestSound:
            rvads_autopilot = pytest.fixture(lambda self: rvads.Reference)

            @rvads.scenario("stop4", classes=1, grid="C", duration=1)
            def test_it(self, run):
                assert run.duration == 1
    """)
    result = pytester.runpytest("-p", "no:cacheprovider", "--rvads-report=out.json", "--rvads-decision-limit=0.3")
    assert result.ret == pytest.ExitCode.TESTS_FAILED or (name in ("label", "__qualname__") and "sleep" not in does)
    records = records_of(pytester.path)
    assert {record["status"] for record in records} <= {"PASS", "ERROR", "NA"}, "nothing is skipped"
    assert [record["outcome"] for record in records if "TestSound" in record["nodeid"]] == ["passed"]


@pytest.mark.extended
def test_late_driver_is_asked_again_in_the_next_test(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import time
        from functools import partial
        import pytest
        import pytest_rvads as rvads

        class Pilot(rvads.Reference):
            def __init__(self, slow):
                super().__init__()
                self.slow = slow

            def control(self, seen):
                time.sleep(600 * self.slow)
                return super().control(seen)

        class TestSlow:
            rvads_autopilot = pytest.fixture(lambda self: partial(Pilot, True))

            @rvads.scenario("stop4", classes=(1, 2, 3), grid="C", duration=1)
            def test_it(self, run): ...

        class TestQuick:
            rvads_autopilot = pytest.fixture(lambda self: partial(Pilot, False))

            @rvads.scenario("stop4", classes=1, grid="C", duration=1)
            def test_it(self, run):
                assert run.duration == 1
    """)
    result = pytester.runpytest("-p", "no:cacheprovider", "--rvads-decision-limit=0.3")
    result.assert_outcomes(errors=3, passed=1)


@pytest.mark.extended
def test_forked_child_of_a_driver_leaves_the_session(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import os, sys
        import pytest
        import pytest_rvads as rvads

        class Parent(rvads.Reference):
            forked = 0

            def control(self, seen):
                way = ("exits", "raises", "returns")[Parent.forked % 3]
                Parent.forked += 1
                child = os.fork()
                if not child:
                    if way == "exits":
                        sys.exit(3)
                    if way == "raises":
                        raise ValueError
                    return rvads.Control()
                open("children", "a").write(f"{way}:{os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])} ")
                return super().control(seen)

        rvads_autopilot = pytest.fixture(lambda: Parent)

        @rvads.scenario("stop4", classes=1, grid="C", subject=0, traffic="reference", duration=0.04)
        def test_it(run):
            open("sessions", "a").write("one ")
    """)
    pytester.runpytest_subprocess("-p", "no:cacheprovider", timeout=60)
    assert (pytester.path / "sessions").read_text(encoding="utf-8") == "one "
    children = (pytester.path / "children").read_text(encoding="utf-8").split()
    assert set(children) == {"exits:3", "raises:1", "returns:0"}


def test_how_numpy_treats_errors_in_a_driver_holds_for_its_run_alone(pytester: pytest.Pytester) -> None:
    _, *sound = session(pytester, "import numpy as np; np.seterr(all='raise')")
    assert [record["status"] for record in sound] == ["PASS", "PASS"]


@pytest.mark.slow
@pytest.mark.parametrize("keeps", ["threading.Thread(target=time.sleep, args=(50,)).start()", "atexit.register(time.sleep, 50)"])
def test_what_keeps_the_process_after_its_session_is_not_waited_for(pytester: pytest.Pytester, keeps: str) -> None:
    does = f"import atexit, threading; {keeps}; raise ValueError"
    pytester.makepyfile(test_it=SESSION.format(does=does, classes=(1,)))
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider", timeout=60)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["*2 passed, 1 error*"])
    assert "keeps its process, which ends now" in result.stderr.str()


def test_exception_without_a_text_is_named_by_its_type(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest
        import pytest_rvads as rvads

        ERRORS = (StopIteration(), AssertionError(), KeyError(""), MemoryError(), rvads.errors.RunError(""))

        class Breaks:
            name = "breaks"

            def __init__(self, error):
                self.error = error

            def __call__(self, case, watch=None):
                raise self.error

            def vmax(self, distance, aggression=1, vehicle=None):
                return None

        @pytest.fixture(params=ERRORS)
        def rvads_simulator(request):
            return Breaks(request.param)

        @rvads.scenario("stop4", classes=1, grid="C", rules="p1")
        def test_it(rule, monitor):
            monitor.check(rule)
    """)
    pytester.runpytest("-p", "no:cacheprovider", "--rvads-autopilot=reference", "--rvads-report=out.json")
    messages = [record["message"] for record in records_of(pytester.path)]
    named = sorted(message.partition(" (test_")[0] for message in messages)
    assert named == ["AssertionError", "KeyError: ''", "MemoryError", "RunError", "StopIteration"]
