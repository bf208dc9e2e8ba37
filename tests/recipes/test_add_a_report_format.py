"""The recipe "Add a report format" of CONTRIBUTING.md: a function of a report, and a line in the table FORMATS."""

from importlib.metadata import version
from pathlib import Path

import pytest

from pytest_rvads.cli import main
from pytest_rvads.report import files
from pytest_rvads.report.outline import outline
from pytest_rvads.report.session_report import Report

TESTS = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=1, grid="E", rules="p1", duration=3)
    def test_rules(run, rule, monitor):
        monitor.verdict(rule)
"""


def plain(report: Report, folder: Path) -> str:
    """What a newcomer writes: all that a report says, as text."""
    return "".join(f"{block.title}\n" + "".join(f"  {line}\n" for line in block.plain()) for block in outline(report))


def test_a_function_and_a_line_are_a_format(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(TESTS)
    refused = pytester.runpytest("--rvads-report=out.txt")
    refused.stderr.fnmatch_lines(["*rvads_report must name a .json, .html, .md, .csv* file, got 'out.txt'*"])
    monkeypatch.setitem(files.FORMATS, ".txt", plain)
    pytester.runpytest("--rvads-report=out.txt", "--rvads-report=out.json", "--rvads-autopilot=reference")
    text = (pytester.path / "out.txt").read_text(encoding="utf-8")
    assert f"driven by pytest_rvads.drivers.reference.Reference (pytest-rvads {version('pytest-rvads')}): 1 run" in text
    main(["report", "merge", str(pytester.path / "out.json"), "-o", str(pytester.path / "merged.txt")])
    assert (pytester.path / "merged.txt").read_text(encoding="utf-8").splitlines()[-1] == text.splitlines()[-1]
