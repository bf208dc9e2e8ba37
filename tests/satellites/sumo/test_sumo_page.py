"""The tables and outputs in docs/sumo.md match SUMO and the commands."""

import re
from pathlib import Path
from types import ModuleType

import pytest

from pytest_rvads.cli import main
from tests.tool_modules import tool

from .with_sumo import needs_sumo

pytestmark = needs_sumo

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "sumo.md").read_text(encoding="utf-8")
SHOWN = {
    command: [line.strip() for line in lines.splitlines() if line.strip(" .")]
    for command, lines in re.findall(r"^```text\n\$ (.*)\n((?:(?!```).*\n)*)```", PAGE, re.MULTILINE)
}


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    return tool("make_sumo_tables")


def holds(tables: ModuleType, place: str) -> None:
    verdicts = tables.judged(place, tables.rules_of(place))
    for name, lines in ((place, tables.totals(verdicts)), (f"{place} by class", tables.by_class(place, verdicts))):
        assert not lines or f"<!-- {name} -->" in PAGE
        assert tables.written(PAGE, name, lines) == PAGE, "run: python tools/make_sumo_tables.py"


@pytest.mark.extended
def test_tables_of_the_t_junction_match_sumo(tables: ModuleType) -> None:
    holds(tables, "stop3")


@pytest.mark.slow
def test_all_tables_match_sumo(tables: ModuleType) -> None:
    for place in tables.PLACES:
        holds(tables, place)
    assert tables.written(PAGE, tables.VARIANTS, tables.variants()) == PAGE


@pytest.mark.extended
@pytest.mark.parametrize("command", [command for command in SHOWN if command.startswith("pytest")], ids=["alone", "traffic"])
def test_sessions_print_the_output_of_the_page(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    """The page shows the output of a terminal of 80 columns, without the version."""
    monkeypatch.setenv("COLUMNS", "80")
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    pytester.makepyfile(test_sumo=code)
    lines = pytester.runpytest(*command.split()[1:]).outlines
    printed = [re.sub(r"\(pytest-rvads [^)]*\)", "(pytest-rvads ...)", line).strip() for line in lines]
    for line in SHOWN[command]:
        assert line in printed


@pytest.mark.extended
def test_braking_limits_of_sumo_equal_those_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    told = "`rvads dynamics braking --simulator sumo` and `--autopilot sumo` print the same as `rvads dynamics braking`."
    assert told in " ".join(PAGE.split())
    printed = []
    for options in ([], ["--simulator", "sumo"]):
        assert main(["dynamics", "braking", *options]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]
