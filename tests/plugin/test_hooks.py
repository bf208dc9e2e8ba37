"""Hooks: junctions, rules and grids of users, a call per verdict; requirements and what traces to them."""

import csv

import pytest

from .conftest import Lines

Names = Lines

TEST = """
    import pytest_rvads as rvads

    @rvads.scenario({arguments})
    def test_it(run, rule, monitor):
        monitor.check(rule)
"""
MAP = """
    from pathlib import Path
    import pytest_rvads

    def pytest_rvads_junctions(config):
        return {"bridge": (Path(pytest_rvads.__file__).parent / "geometry" / "data" / "stop3.xodr", "3-way stop")}
"""


def collect(pytester: pytest.Pytester, arguments: str, *options: str) -> pytest.RunResult:
    pytester.makepyfile(TEST.format(arguments=arguments))
    return pytester.runpytest("--collect-only", "-q", *options)


def test_a_junction_by_a_name_of_ones_own(pytester: pytest.Pytester, brackets: Names) -> None:
    pytester.makeconftest(MAP)
    result = collect(pytester, '"bridge", classes=1, grid="B", rules="p1"')
    assert brackets(result) == ["stop3.1-class01-as111-cfgB-p1"], "ids name the file, as they do for map="
    pytester.runpytest().assert_outcomes(passed=1)


@pytest.mark.extended
def test_a_grid_by_a_name_of_ones_own(pytester: pytest.Pytester, brackets: Names) -> None:
    pytester.makeconftest(
        """
        def pytest_rvads_grids(config):
            return {"rush": ([5.0, 20.0], [0.0, 9.0])}
        """
    )
    # To stop from 9 m/s within 5 m takes 9^2 / (2 * 5) = 8.1 m/s^2, more than a service brake gives.
    mixed = brackets(collect(pytester, '"stop4", classes=1, grid=("B", "rush"), rules="p1"'))
    assert [name.split("-")[3] for name in mixed] == ["cfgB", "cfgd05.00v00.00", "cfgd20.00v00.00", "cfgd20.00v09.00"]
    assert len(brackets(collect(pytester, '"stop4", classes=1, rules="p1"', "--rvads-grid=rush"))) == 3
    assert len(brackets(collect(pytester, '"stop4", classes=1, grid="rush", probe=True, rules="p1"'))) == 4
    pytester.makepyfile(TEST.format(arguments='"stop4", classes=1, grid="rush", rules="p1", duration=1.0'))
    for workers in ((), ("-n", "1")):
        result = pytester.runpytest(*workers)
        result.stdout.fnmatch_lines(["1 point beyond v(d)max left out: 1 of test_a_grid_by_a_name_of_ones_own.py::test_it"])


def test_rules_of_ones_own(pytester: pytest.Pytester, brackets: Names) -> None:
    pytester.makefile(".ini", site="[gets_in]\ntext = forall a. F a@j\nrequirement = REQ-7\n")
    pytester.makeconftest(
        """
        import pytest_rvads as rvads

        def pytest_rvads_rules(config):
            return ["site.ini", rvads.rule("waits", "forall a, j.en. F a@j.en", requirement="REQ-8")]
        """
    )
    assert len(brackets(collect(pytester, '"stop4", classes=1, grid="B", rules=("gets_in", "waits")'))) == 2


@pytest.mark.parametrize(
    ("hook", "says"),
    [
        ("junctions(config):\n    return {'stop4': ('a.xodr', '1')}", "gives 'stop4', which is taken already"),
        ("junctions(config):\n    return {'depot': 'a.xodr'}", "must give a map file and a junction in it for 'depot'"),
        ("junctions(config):\n    return ['depot']", "must give a dict with names as keys, got ['depot']"),
        ("grids(config):\n    return {'C': (1.0, 2.0)}", "gives 'C', which is taken already"),
        ("grids(config):\n    return {'rush': 1.0}", "must give distances and speeds for 'rush', got 1.0"),
        ("rules(config):\n    return 'site.ini'", "must give a list of rules or files of rules, got 'site.ini'"),
        ("rules(config):\n    return ['none.ini']", "none.ini: can't be read"),
        ("rules(config):\n    return [3]", "must give rules made by rvads.rule or files of rules, got 3"),
    ],
)
def test_hooks_that_give_something_else(pytester: pytest.Pytester, hook: str, says: str) -> None:
    pytester.makeconftest(f"def pytest_rvads_{hook}\n")
    result = collect(pytester, '"stop4"')
    assert result.ret == pytest.ExitCode.INTERRUPTED
    assert says in result.stdout.str()
    result.stdout.no_fnmatch_line("*Traceback*")


@pytest.mark.extended
@pytest.mark.parametrize("workers", [(), ("-n", "1")])
@pytest.mark.usefixtures("reference")
def test_a_call_per_verdict(pytester: pytest.Pytester, workers: tuple[str, ...]) -> None:
    pytester.makeconftest(
        """
        def pytest_rvads_verdict(record, config):
            assert not hasattr(config, "workerinput")
            with open("seen", "a") as out:
                print(record["rule"], record["status"], file=out)
        """
    )
    pytester.makepyfile(TEST.format(arguments='"stop4", classes=1, grid="B", rules=("p1", "p4"), duration=4'))
    assert pytester.runpytest(*workers).ret == 0
    assert pytester.path.joinpath("seen").read_text(encoding="utf-8").splitlines() == ["p1 PASS", "p4 NA"]


def test_a_hook_that_fails_costs_no_verdict(pytester: pytest.Pytester) -> None:
    pytester.makeconftest("def pytest_rvads_verdict(record):\n    raise OSError('no dashboard')\n")
    pytester.makepyfile(TEST.format(arguments='"stop4", classes=(1, 2), grid="B", rules="p1", duration=4'))
    result = pytester.runpytest()
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["rvads: a hook pytest_rvads_verdict raised OSError: no dashboard (conftest.py:2)"])
    assert result.ret == pytest.ExitCode.TESTS_FAILED


@pytest.mark.usefixtures("reference")
def test_requirements_are_traced_to_verdicts(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        rvads.rule("gets_in", "forall a. F a@j", requirement="REQ-7")

        @rvads.scenario("stop4", classes=1, grid="B", rules=("gets_in", "p4"), requirement=("SYS-1", "SYS-2"))
        def test_traced(run, rule, monitor):
            monitor.check(rule)

        @rvads.scenario("stop4", classes=1, grid="B", rules="p1")
        def test_untraced(run, rule, monitor):
            monitor.check(rule)
        """
    )
    assert pytester.runpytest("--rvads-report=trace.csv").ret == 0
    with pytester.path.joinpath("trace.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["requirement"], r["rule"], r["verdict"]) for r in rows] == [
        ("REQ-7", "gets_in", "PASS"),
        ("SYS-1", "gets_in", "PASS"),
        ("SYS-1", "p4", "NA"),
        ("SYS-2", "gets_in", "PASS"),
        ("SYS-2", "p4", "NA"),
        ("", "p1", "PASS"),
    ]
    refused = pytester.runpytest("--rvads-report=out.xml")
    refused.stderr.fnmatch_lines(["*rvads_report must name a *got 'out.xml': pytest writes JUnit XML, --junitxml=out.xml"])
    assert {(r["junction"], r["class"], r["scenario"], r["configuration"]) for r in rows} == {("stop4", "1", "1111", "B")}
    assert len({r["run"] for r in rows}) == 1, "one run, whichever test it was simulated for"
    assert all("numpy " in r["versions"] and "pytest-rvads " in r["versions"] for r in rows)
