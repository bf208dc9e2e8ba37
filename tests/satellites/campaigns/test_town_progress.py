"""How far a long command is: a line per tenth where there is no terminal, on standard error alone."""

import sys

import pytest

from pytest_rvads.satellites.campaigns.replays import progressing


def test_without_a_terminal_there_is_a_line_per_tenth(capsys: pytest.CaptureFixture[str]) -> None:
    with progressing("runs") as told:
        for done in range(1, 201):
            told(done, 200)
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert out == ""
    assert len(lines) == 11
    assert lines[0] == "1/200 runs"
    assert lines[-1] == "200/200 runs"


def test_a_command_that_goes_on_begins_where_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    with progressing("runs") as told:
        told(95, 100)
        told(100, 100)
    assert capsys.readouterr().err.splitlines() == ["95/100 runs", "100/100 runs"]


def test_on_a_terminal_there_is_a_bar_with_what_is_left(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with progressing("runs") as told:
        told(3, 12)
        told(12, 12)
    out, err = capsys.readouterr()
    assert out == ""
    assert "12/12" in err
    assert "left" in err
