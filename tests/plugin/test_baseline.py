"""What did my change break: sessions beside an earlier one, and runs that are not deterministic."""

import json

import pytest

from pytest_rvads.cli import main
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.plugin import pytest_assertrepr_compare
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from tests.inner_sessions import driven_by, records_of

CONFTEST = driven_by('type("Pilot", (Racer if {racing} else rvads.Reference,), {{}})')

TESTS = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=(1, 2), grid="B", rules=("p1", "p4"), duration=5)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""


def session(pytester: pytest.Pytester, racing: str, *options: str) -> pytest.RunResult:
    pytester.makeconftest(CONFTEST.format(racing=racing))
    return pytester.runpytest(*options)


@pytest.fixture
def tests(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makepyfile(test_it=TESTS)
    return pytester


FIRST = 'request.node.callspec.id.startswith("stop4-class01")'
SECOND = 'request.node.callspec.id.startswith("stop4-class02")'


@pytest.mark.extended
def test_new_failures_fail_and_old_ones_need_not(tests: pytest.Pytester) -> None:
    session(tests, SECOND, "--rvads-report=old.json")
    against = ("--rvads-baseline=old.json", "--rvads-fail-on=new")
    same = session(tests, SECOND, *against)
    same.assert_outcomes(failed=1, passed=1, skipped=2)
    assert same.ret == 0
    same.stdout.fnmatch_lines(["against old.json: 4 UNCHANGED", "rvads: 1 item failed as in the baseline, which *=new lets pass"])
    assert session(tests, "True", "--rvads-baseline=old.json", "--rvads-fail-on=eroded").ret == pytest.ExitCode.TESTS_FAILED
    worse = session(tests, "True", *against, "--rvads-report=now.json")
    assert worse.ret == pytest.ExitCode.TESTS_FAILED
    worse.stdout.fnmatch_lines(
        [
            "*rvads verdicts*",
            "against old.json: 1 NEW, 3 UNCHANGED",
            "  NEW     test_it.py::test_rules[[]stop4-class01-as1111-cfgB-p1[]]  p1 at t=*",
        ]
    )
    records = records_of(tests.path, "now.json")
    assert [r["change"] for r in records] == ["NEW", "UNCHANGED", "UNCHANGED", "UNCHANGED"]
    better = session(tests, "False", *against)
    assert better.ret == 0
    better.stdout.fnmatch_lines(["against old.json: 1 FIXED, 3 UNCHANGED", "  FIXED   test_it.py::test_rules[[]stop4-class02*"])
    assert session(tests, SECOND, "--rvads-baseline=old.json").ret == 1, "without --rvads-fail-on every failure counts"


@pytest.mark.extended
def test_other_failures_always_count(tests: pytest.Pytester) -> None:
    session(tests, SECOND, "--rvads-report=old.json")
    tests.makepyfile(test_plain="def test_plain():\n    assert 1 == 2\n")
    result = session(tests, SECOND, "--rvads-baseline=old.json", "--rvads-fail-on=new")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    tests.makepyfile(test_plain="def test_plain(): ...")
    stopped = session(tests, SECOND, "--rvads-baseline=old.json", "--rvads-fail-on=new", "-x", "-k", "p1 or plain")
    assert stopped.ret == pytest.ExitCode.TESTS_FAILED, "test_plain did not run, so this is no success"
    early = session(tests, FIRST, "--rvads-baseline=old.json", "--rvads-fail-on=new", "-x", "-k", "p1 or plain")
    assert early.ret == pytest.ExitCode.TESTS_FAILED
    early.stdout.fnmatch_lines(["against old.json: 1 NEW, 1 NOT RUN, 2 OUTSIDE", "rvads: the session stopped early: 1 item *"])


def test_lost_items_differ_from_deselected_items(tests: pytest.Pytester) -> None:
    session(tests, "False", "--rvads-report=old.json")
    part = session(tests, "False", "--rvads-baseline=old.json", "-k", "class01")
    part.stdout.fnmatch_lines(["against old.json: 2 UNCHANGED, 2 OUTSIDE"])
    named = session(tests, "False", "--rvads-baseline=old.json", "test_it.py::test_rules[stop4-class01-as1111-cfgB-p1]")
    named.stdout.fnmatch_lines(["against old.json: 1 UNCHANGED, 3 OUTSIDE"])
    tests.makepyfile(test_it=TESTS.replace("(1, 2)", "1"))
    less = session(tests, "False", "--rvads-baseline=old.json")
    less.stdout.fnmatch_lines(
        ["against old.json: 1 LOST, 2 UNCHANGED", "  LOST    *class02*-p1]  was PASS, does not exist any more"]
    )


ONE_RUN = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=1, distances=0.3, rules="p1", duration=10)
    def test_enters(run, rule, monitor):
        monitor.check(rule)

    test_enters_again = test_enters
"""


@pytest.mark.extended
def test_eroded_run_is_one_change_for_several_items(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=ONE_RUN)
    session(pytester, "False", "--rvads-report=old.json")
    report = json.loads((pytester.path / "old.json").read_text(encoding="utf-8"))
    for record in report["records"]:
        record["kpis"]["ttc"] += 1.0
    (pytester.path / "old.json").write_text(json.dumps(report), encoding="utf-8")
    lets = session(pytester, "False", "--rvads-baseline=old.json", "--rvads-fail-on=new", "--rvads-report=now.json")
    lets.stdout.fnmatch_lines(
        [
            "against old.json: 1 ERODED, 1 UNCHANGED",
            "  ERODED  test_it.py::test_enters[[]*-p1[]]  ttc 1.48 -> 0.48 s, in 2 items of its run",
        ]
    )
    assert lets.ret == 0
    now = json.loads((pytester.path / "now.json").read_text(encoding="utf-8"))
    assert [record["change"] for record in now["records"]] == ["ERODED", "UNCHANGED"]
    fails = session(pytester, "False", "--rvads-baseline=old.json", "--rvads-fail-on=eroded")
    assert fails.ret == pytest.ExitCode.TESTS_FAILED


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--rvads-baseline=none.json",), "*rvads_baseline: *none.json can't be read as a report*"),
        (("--rvads-fail-on=new",), "*rvads_fail_on=new needs something to compare with*"),
    ],
)
def test_misuse(tests: pytest.Pytester, options: tuple[str, ...], says: str) -> None:
    result = tests.runpytest(*options)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([says])


FLAKY = driven_by(
    'Moody if "moody" in request.function.__name__ else Racer',
    """
    class Moody(rvads.Reference):
        runs = 0

        def control(self, seen):
            if seen.time == 0 and seen.me.name == "a0":
                Moody.runs += 1
            if seen.me.name == "a0" and seen.time > 0.995 and Moody.runs > 1:
                return rvads.Control(brake=1.0)
            return super().control(seen)

    @rvads.scenario("stop4", classes=7, grid="C", duration=6)
    def test_moody(run):
        assert not run.steps

    @rvads.scenario("stop4", classes=7, grid="C", rules=("p1", "p2"), duration=6)
    def test_racer(run, rule, monitor):
        monitor.check(rule)
""",
)


@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "1"), marks=pytest.mark.slow)])
def test_a_run_that_can_t_be_repeated_is_flaky(pytester: pytest.Pytester, workers: tuple[str, ...]) -> None:
    pytester.makepyfile(test_it=FLAKY)
    result = pytester.runpytest("--rvads-report=out.json", *workers)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(
        [
            "*rvads not deterministic*",
            "First difference: t=1.00 s (tick 100): * of a0 is * in one run, * in the other.",
            "*07*FLAKY*",
            "stop4: *1 flaky*",
            "*1 x run: not deterministic: the same start gave another run",
        ]
    )
    records = records_of(pytester.path)
    status = {r["nodeid"].partition("::")[2].partition("[")[0] + (r["rule"] or ""): r["status"] for r in records}
    assert status["test_moody"] == "FLAKY"
    assert status["test_racerp1"] == "FAIL", "a deterministic failure is just a failure"


def test_merged_shards_beside_a_baseline(tests: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    session(tests, "False", "--rvads-report=old.json")
    session(tests, SECOND, "--rvads-report=a.json", "-k", "class01")
    session(tests, SECOND, "--rvads-report=b.json", "-k", "class02 and p1")
    old, *shards = (str(tests.path / f"{name}.json") for name in ("old", "a", "b"))
    capsys.readouterr()
    assert main(["report", "merge", *shards, "--baseline", old]) == 1
    said = capsys.readouterr().out.splitlines()
    (headline,) = (number for number, line in enumerate(said) if line.startswith("against "))
    assert said[headline].endswith("old.json: 1 NEW, 2 UNCHANGED, 1 OUTSIDE")
    assert said[headline + 1].startswith("  NEW     test_it.py::test_rules[stop4-class02-as1112-cfgB-p1]  p1 at t=")


@pytest.mark.extended
def test_baseline_of_another_formula_of_a_rule_lets_no_failure_pass(pytester: pytest.Pytester, reference: None) -> None:
    tests = """
        import pytest_rvads as rvads

        rvads.rule("calm", "{formula}")

        @rvads.scenario("stop4", classes=1, grid="B", rules="calm", duration=1)
        def test_it(run, rule, monitor):
            monitor.check(rule)
    """
    pytester.makepyfile(test_it=tests.format(formula="forall a. F a@j & G !a@j"))
    assert pytester.runpytest("--rvads-report=old.json").ret == 1
    against = ("--rvads-baseline=old.json", "--rvads-fail-on=new")
    assert pytester.runpytest(*against).ret == 0
    pytester.makepyfile(test_it=tests.format(formula="forall a. F a@j & G !a@j & F a@j"))
    result = pytester.runpytest(*against)
    assert result.ret == 1
    result.stdout.fnmatch_lines(["against old.json: 1 NEW", "*1 item by a rule calm that is not the same any more: not *"])


def test_comparing_runs_and_verdicts(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        from dataclasses import replace

        import pytest
        import pytest_rvads as rvads

        @pytest.fixture(scope="module")
        def run():
            case = rvads.Case(rvads.Scenario(rvads.find("stop4"), "1133", distance=0.3, duration=1.0), rvads.Reference)
            return rvads.simulate(case)

        def test_differ(run):
            speed = run.speed.copy()
            speed[50, 2] += 1.0
            assert run == replace(run, speed=speed)

        def test_same(run):
            assert run != replace(run)

        def test_verdicts(run):
            assert rvads.check(run, "p1") == rvads.check(run, "p4")

        def test_plain():
            assert 1 == 2
        """
    )
    result = pytester.runpytest()
    result.assert_outcomes(failed=4)
    result.stdout.fnmatch_lines(
        [
            "E       assert <Run stop4-class07-as1133-cfgd00.30v00.00: 4 vehicles, 1.00 s> == <Run *",
            "E         t=0.50 s (tick 50): speed of a2 is * in one run, * in the other",
            "E       assert <Run * != <Run *",
            "E         the same bit for bit, hash *",
            "E       assert p1 * == p4 NA",
            "E         p1 *",
            "E         p4 NA: *",
        ]
    )


def test_only_two_runs_or_two_verdicts_are_compared_in_words() -> None:
    run = simulate(Case(Scenario(find("stop4"), "1133", distance=0.3, duration=0.1), Reference))
    verdict = check(run, "p4")
    assert pytest_assertrepr_compare("==", verdict, check(run, "p3")) is not None
    assert pytest_assertrepr_compare("==", run, run) is not None
    for pair in ((verdict, "NA"), ("NA", verdict), (run, 3), (3, run), (run, verdict), (1, 2)):
        assert pytest_assertrepr_compare("==", *pair) is None
    assert pytest_assertrepr_compare("<", verdict, verdict) is None
