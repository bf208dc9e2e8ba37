"""A time budget: what comes first, and that what comes too late is never green."""

import pytest

from pytest_rvads.report.record import Record, SimulatedItem, planned_record
from pytest_rvads.session.interrupts import priority
from tests.inner_sessions import driven_by, records_of


def starts(classes: int, configurations: str) -> list[Record]:
    return [
        planned_record(
            f"t.py::test[{cls}-{cfg}-{rule}]",
            1,
            "test",
            {"junction": "stop4", "cls": cls, "scenario": str(cls), "cfg": cfg, "rotation": 0, "rule": rule},
            4,
        )
        for cls in range(1, classes + 1)
        for cfg in configurations
        for rule in ("p1", "p2")
    ]


def runs(order: list[str]) -> list[str]:
    """The runs in order, after checking that the items of each stay together."""
    names = [nodeid.partition("[")[2].rpartition("-")[0] for nodeid in order]
    assert names[::2] == names[1::2]
    return names[::2]


def test_one_run_of_every_class_comes_first() -> None:
    order = runs(priority(starts(3, "CDE"), {}, {}))
    assert order[:3] == ["1-C", "2-D", "3-E"], "every class, and the configurations in turn"
    assert [name[0] for name in order[3:6]] == ["1", "2", "3"], "then the classes take turns"
    assert sorted(order) == sorted(f"{c}-{g}" for c in (1, 2, 3) for g in "CDE")


def test_last_failures_come_before_everything() -> None:
    order = runs(priority(starts(3, "CDE"), {"t.py::test[3-D-p2]": True, "t.py::test[gone]": True}, {}))
    assert order[0] == "3-D"
    assert {name[0] for name in order[1:4]} >= {"1", "2"}


def test_what_ran_least_comes_next() -> None:
    records = starts(2, "CD")
    history = {r.nodeid: 5 for r in records if isinstance(r, SimulatedItem) and (r.cls == 1 or r.cfg == "C")}
    assert runs(priority(records, {}, history)) == ["1-C", "2-D", "1-D", "2-C"]


TESTS = driven_by(
    'Racer if "class03" in request.node.name else rvads.Reference',
    """
    def test_plain(): ...

    @rvads.scenario("stop4", classes=(1, 2, 3), grid="B", rules="p1", duration=5)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
""",
)


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), ("-n", "1")])
def test_what_comes_too_late_is_not_run(pytester: pytest.Pytester, workers: tuple[str, ...]) -> None:
    pytester.makepyfile(test_it=TESTS)
    result = pytester.runpytest("--rvads-time-budget=0", "--rvads-report=out.json", "-v", *workers)
    assert result.ret == pytest.ExitCode.NO_TESTS_COLLECTED, "nothing was judged"
    assert result.parseoutcomes() == {"passed": 1, "not": 3}, "1 passed, 3 not run"
    result.stdout.fnmatch_lines(["rvads: the time budget of 0 s is used up: 3 items did not run"])
    records = records_of(pytester.path)
    assert [r["status"] for r in records] == ["NOT RUN"] * 3


def test_user_skip_is_no_late_item(pytester: pytest.Pytester) -> None:
    skipping = "@pytest.mark.skip('NOT RUN: by hand')\n@rvads.scenario"
    pytester.makepyfile(test_it=TESTS.replace("@rvads.scenario", skipping))
    assert pytester.runpytest("--rvads-time-budget=600").parseoutcomes() == {"passed": 1, "skipped": 3}


@pytest.mark.extended
def test_failures_run_first_the_next_time(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS)
    first = pytester.runpytest("--rvads-time-budget=600", "-v")
    first.assert_outcomes(passed=3, failed=1)
    second = pytester.runpytest("--rvads-time-budget=600", "-v")
    ran = [line.partition("::")[2].partition(" ")[0] for line in second.outlines if line.startswith("test_it.py::")]
    assert ran == [f"test_rules[stop4-class0{n}-as111{n}-cfgB-p1]" for n in (3, 1, 2)] + ["test_plain"]
    assert pytester.runpytest("--rvads-time-budget=600", "-p", "no:cacheprovider").parseoutcomes() == first.parseoutcomes()


def test_what_ran_before_comes_last(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS.replace('grid="B"', 'grid="BC"'))
    pytester.runpytest("--rvads-time-budget=600", "-k", "class01 and cfgB").assert_outcomes(passed=1, deselected=6)
    second = pytester.runpytest("--rvads-time-budget=600", "-v", "-k", "class01")
    ran = [line.partition("-cfg")[2][:1] for line in second.outlines if line.startswith("test_it.py::")]
    assert ran == ["C", "B"]


def test_a_budget_of_words_is_refused(pytester: pytest.Pytester) -> None:
    result = pytester.runpytest("--rvads-time-budget=soon")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*rvads_time_budget must be a number from 0 to 1e+06, got 'soon'*"])
