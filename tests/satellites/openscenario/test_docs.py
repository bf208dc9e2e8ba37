"""The code of docs/openscenario.md runs, and its commands print what is shown."""

import re
import shlex
from pathlib import Path

import pytest

from pytest_rvads.cli import main

PAGE = (Path(__file__).parents[3] / "docs" / "openscenario.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(python|console)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.usefixtures("library")
def test_code_and_commands_of_the_page_print_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its blocks run in order in one folder; a comment behind a line that prints says what it prints."""
    monkeypatch.chdir(tmp_path)
    assert [kind for kind, _ in BLOCKS] == ["python", "console", "console", "console", "python"]
    for kind, text in BLOCKS:
        if kind == "python":
            exec(compile(text, "docs/openscenario.md", "exec"), {})
            assert capsys.readouterr().out.splitlines() == re.findall(r"^print\(.*\)  # (.*)$", text, re.MULTILINE)
            continue
        for command, output in re.findall(r"^\$ rvads (.*)\n((?:(?!\$ ).*\n)*)", text, re.MULTILINE):
            assert main(shlex.split(command)) in (0, 1)
            shown, _, after_dots = output.partition("...\n")
            assert after_dots == ""
            assert capsys.readouterr().out.startswith(shown)
    assert Path("again/rolling.xosc").read_bytes() == Path("failure/rolling.xosc").read_bytes()
