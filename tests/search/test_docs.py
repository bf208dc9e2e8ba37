"""The Python code of docs/search.md and docs/critical.md runs, and the command of docs/critical.md prints what the page shows."""

import re
import shlex
from pathlib import Path

import pytest

from pytest_rvads.cli import main

DOCS = Path(__file__).parents[2] / "docs"
SEARCH, CRITICAL = ((DOCS / name).read_text(encoding="utf-8") for name in ("search.md", "critical.md"))
BLOCKS = re.findall(r"```python\n(.*?)```", SEARCH + CRITICAL, re.DOTALL)


@pytest.mark.extended
@pytest.mark.parametrize("block", BLOCKS, ids=[str(k) for k in range(len(BLOCKS))])
def test_code_in_the_documentation_runs(block: str, pytester: pytest.Pytester) -> None:
    pytester.makepyfile(block if "def test_" in block else "def test_block():\n" + re.sub("(?m)^", "    ", block))
    driven = ["--rvads-autopilot=reference"] if "critical" in block else []
    result = pytester.runpytest("-p", "no:cacheprovider", *driven)
    assert result.ret == 0


@pytest.mark.extended
def test_command_prints_the_lines_of_the_page(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.syspath_prepend(str(DOCS.parent / "tests" / "drivers"))
    command, shown = re.findall(r"\$ (rvads critical .*)\n((?:.*\n)*?)```", CRITICAL)[0]
    assert main([*shlex.split(command)[1:], "-j", "1"]) == 1
    printed = capsys.readouterr().out.splitlines()
    for line in shown.splitlines():
        assert line in printed or line == "...", line
