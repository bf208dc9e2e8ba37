"""The options that choose the executor of a command."""

import argparse
import os
from importlib import util
from typing import Any

import pytest

from pytest_rvads.cli import common, main
from pytest_rvads.cli.common import opened_executor, share
from pytest_rvads.support.errors import RvadsError


def parsed(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    share(parser, "workers")
    return parser.parse_args(arguments)


@pytest.mark.parametrize(("arguments", "executor"), [((), os.cpu_count()), (("-j", "3"), 3), (("--workers", "1"), 1)])
def test_processes_are_counted(arguments: tuple[str, ...], executor: int | None) -> None:
    with opened_executor(parsed(*arguments)) as opened:
        assert opened == executor


def test_a_command_takes_processes_or_a_scheduler(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper", "-j", "0"]) == 2
    assert "--workers must be at least 1, got 0" in capsys.readouterr().err
    assert main(["check", "run.npz", "-j", "tcp://127.0.0.1:8786"]) == 2
    assert "--workers must be a number of processes for this command" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere at all"])
def test_where_no_scheduler_answers_it_is_said(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(common, "_PATIENCE", 0.5)
    with (
        pytest.raises(RvadsError, match=f"no Dask scheduler answers at '{address}' .*expected an address"),
        opened_executor(parsed("-j", address)),
    ):
        pass


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(name: str, *rest: Any) -> Any:
        return None

    monkeypatch.setattr(common, "find_spec", find)
    assert util.find_spec is not find
    with pytest.raises(RvadsError, match=r"pip install 'pytest-rvads\[dask\]'"), opened_executor(parsed("-j", "x")):
        pass
