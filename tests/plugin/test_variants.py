"""Further parameters of a test, such as four versions of a controller, are an axis of its own in every output."""

import csv
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.cli.report_commands import merge
from pytest_rvads.report.files import load, markdown
from pytest_rvads.report.matrix import Matrices, Matrix
from pytest_rvads.session.interrupts import priority
from pytest_rvads.session.plan import _variant
from tests.inner_sessions import driven_by, records_of

CONFTEST = driven_by(
    "lambda *given: (Racer if {racing!r} in request.param else rvads.Reference)(*given)",
    params="{params}",
)

TESTS = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=(1, 2), grid="B", rules=("p1", "p4"), duration={duration})
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""
VERSIONS = ["v1", "v2", "v3", "v4"]


def session(
    pytester: pytest.Pytester,
    *options: str,
    params: str = str(VERSIONS),
    tests: str = TESTS,
    duration: int = 1,
    racing: str = "v3",
) -> pytest.RunResult:
    """Run the tests; within a second only the racer enters, which is quick to simulate."""
    pytester.makeconftest(CONFTEST.format(params=params, racing=racing))
    pytester.makepyfile(test_it=tests.format(duration=duration))
    return pytester.runpytest("-p", "no:cacheprovider", *options)


def matrix(report: Path) -> Matrix:
    matrices = Matrices()
    for record in load(report).records:
        matrices.add(record)
    (found,) = matrices.matrices()
    return found


def test_each_version_of_a_controller_has_rows_of_its_own(pytester: pytest.Pytester) -> None:
    outputs = ("--rvads-report=out.json", "--rvads-report=out.csv", "--junitxml=out.xml", "-o", "junit_family=xunit1")
    result = session(pytester, *outputs, duration=3)
    result.assert_outcomes(passed=6, failed=2, skipped=8)
    result.stdout.fnmatch_lines([" variant, class*", " v1  01-02 *pass *NA*", " v2  *pass*", " v3  *FAIL*", " v4  *pass*"])
    found = matrix(pytester.path / "out.json")
    assert found.variants == tuple(VERSIONS)
    said = [(label, [entry.text for entry in entries]) for label, entries in found.rows]
    assert said == [(f"{name}  01-02", ["FAIL" if name == "v3" else "pass", "NA"]) for name in VERSIONS]

    records = records_of(pytester.path)
    with (pytester.path / "out.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    cases = [
        {p.get("name"): p.get("value") for p in case.iter("property")}
        for case in ET.parse(pytester.path / "out.xml").iter("testcase")
    ]
    for told in ([r["variant"] for r in records], [row["variant"] for row in rows], [case["variant"] for case in cases]):
        assert sorted(told) == sorted(VERSIONS * 4)
    assert {case["variant"] for case in cases if case["verdict"] == "FAIL"} == {"v3"}


def test_the_runs_of_versions_are_told_apart_in_figures(pytester: pytest.Pytester) -> None:
    session(pytester, "--rvads-report=r.json")
    report = load(Path("r.json"))
    runs = {f"test_rules[stop4-class{cls}-cfgB, {version}]" for cls in ("01-as1111", "02-as1112") for version in VERSIONS}
    assert set(report.seconds) == runs, "what one version takes is not added to that of another"
    assert {record.where for record in report.records} == runs


def test_without_further_parameters_nothing_is_said_of_variants(pytester: pytest.Pytester, reference: None) -> None:
    pytester.makepyfile(test_it=TESTS.format(duration=1))
    result = pytester.runpytest("--rvads-report=out.json", "--junitxml=out.xml", "-o", "junit_family=xunit1")
    assert " class " in result.stdout.str()
    for said in (result.stdout.str(), *((pytester.path / name).read_text(encoding="utf-8") for name in ("out.json", "out.xml"))):
        assert "variant," not in said
        assert '"variant"' not in said


@pytest.mark.extended
def test_workers_tell_the_same_variants(pytester: pytest.Pytester) -> None:
    """Some seconds, in which workers start."""
    session(pytester, "--rvads-report=one.json")
    session(pytester, "--rvads-report=two.json", "-n2")
    one, two = (matrix(pytester.path / f"{name}.json") for name in ("one", "two"))
    assert one == two
    assert one.variants == tuple(VERSIONS)


def failing(found: Matrix) -> set[str]:
    return {variant for variant, (_, entries) in zip(found.variants, found.rows, strict=True) if entries[0].text == "FAIL"}


def test_a_version_may_have_the_id_of_a_cell_or_of_a_run(pytester: pytest.Pytester) -> None:
    """Neither its runs nor its rows are taken for those of another."""
    run = "stop4-class01-as1111-cfgB"
    names = [run, f"{run}-p1", f"v3-{run}"]
    session(pytester, "--rvads-report=out.json", params=repr(names), racing=names[1]).assert_outcomes(failed=2, skipped=10)
    found = matrix(pytester.path / "out.json")
    assert sorted(found.variants) == sorted(names)
    assert failing(found) == {names[1]}


def test_marks_are_variants_too_and_ids_are_shown_as_text(pytester: pytest.Pytester) -> None:
    names, loads = ["v3 | <b>`x`</b> \x1b[31m", "a-b"], ["full-", "=1+1"]
    marked = f"@pytest.mark.parametrize('load', {loads})\n    @rvads"
    tests = (
        TESTS.replace("import", "import pytest\n    import", 1).replace("@rvads", marked).replace("monitor)", "monitor, load)")
    )
    result = session(pytester, "--rvads-report=out.json", params=repr(names), tests=tests)
    result.assert_outcomes(failed=4, skipped=12)
    found = matrix(pytester.path / "out.json")
    shown = ["v3 | <b>`x`</b> \\x1b[31m", "a-b"]  # pytest escapes what can't be printed
    assert set(found.variants) == {f"{name}, {load}" for name in shown for load in loads}
    assert failing(found) == {f"{shown[0]}, {load}" for load in loads}
    table = [line for line in markdown(load(pytester.path / "out.json")).splitlines() if "01-02" in line]
    assert len(table) == len(found.rows)
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in table} == {len(found.columns) + 2}
    assert "<b>" not in "".join(table)


@pytest.mark.parametrize(
    ("whole", "names", "variant"),
    [
        ("CELL", ["rvads_cell"], ""),
        ("v1-CELL", ["version", "rvads_cell"], "v1"),
        ("CELL-v1", ["rvads_cell", "version"], "v1"),
        ("v1-CELL-x-y", ["version", "rvads_cell", "load"], "v1, x-y"),
        ("p-CELL-CELL", ["version", "rvads_cell"], "p-CELL"),
        ("CELL-p-CELL", ["rvads_cell", "version"], "p-CELL"),
        ("CELL-p-CELL", ["version", "rvads_cell"], "CELL-p"),
        ("XCELL-CELL-CELLX", ["version", "rvads_cell", "load"], "XCELL, CELLX"),
        ("-CELL-", ["version", "rvads_cell", "load"], ""),
        ("--CELL", ["version", "rvads_cell"], "-"),
    ],
)
def test_the_cell_is_found_in_an_id(whole: str, names: list[str], variant: str) -> None:
    assert _variant(whole, names, "CELL") == variant


def test_shards_of_versions_are_merged_into_one_table(pytester: pytest.Pytester) -> None:
    for name in ("v1 or v2", "v2 or v3"):
        session(pytester, f"--rvads-report={name[0:2]}.json", "-k", name)
    both = merge([(name, load(pytester.path / f"{name}.json")) for name in ("v1", "v2")])
    matrices = Matrices()
    for record in both.records:
        matrices.add(record)
    (found,) = matrices.matrices()
    assert found.variants == ("v1", "v2", "v3")
    assert not [note for note in both.notes if " is " in note], "what ran in both said the same"
    assert both.began == load(pytester.path / "v1.json").began
    assert all(f"--rvads-report={name}.json" in both.command for name in ("v1", "v2"))
    worse: Any = {record.nodeid: record.status for record in both.records if record.status == "FAIL"}
    assert {nodeid.partition("[")[2][:2] for nodeid in worse} == {"v3"}


def test_within_a_time_budget_the_versions_of_a_start_stay_together(pytester: pytest.Pytester) -> None:
    """So a class is missing of all of them, or of none, and the report compares like with like."""
    session(pytester, "--rvads-report=out.json")
    records = load(pytester.path / "out.json").records
    order = priority(records, {}, {})
    assert ["class01" in nodeid for nodeid in order] == [True] * 8 + [False] * 8
    assert [nodeid.partition("[")[2][:2] for nodeid in order[:8]] == [name for name in VERSIONS for _ in range(2)]
