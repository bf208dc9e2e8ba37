"""Files of runs, and the names of rules."""

from collections.abc import Callable
from pathlib import Path

import pytest

from pytest_rvads.cli.check_commands import list_rules
from pytest_rvads.cli.common import named_rules
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import save_run
from pytest_rvads.support.errors import RunError

Make = Callable[..., Run]


def test_files_are_read_by_their_kind(make: Make, tmp_path: Path) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 400)
    save_run(run, tmp_path / "run.npz")
    (back,) = read_runs(tmp_path / "run.npz")
    assert back.hash == run.hash
    (tmp_path / "runs.json").write_text("[]")
    with pytest.raises(RunError, match="must be an object"):
        read_runs(tmp_path / "runs.json")
    with pytest.raises(RunError, match=r"expected a file of runs \(.json, .npz, .xosc\), got one ending in '.csv'"):
        read_runs(tmp_path / "runs.csv")


def test_names_of_rules_add_up(tmp_path: Path) -> None:
    (tmp_path / "own.rules").write_text("[mine]\ntext = forall a. F a@j\nrequirement = REQ-9\n")
    names = [r.name for r in named_rules([str(tmp_path / "own.rules"), "p6", "paper"])]
    assert names == ["mine", "p6", "p1", "p2", "p3", "p4", "p5"]
    assert "\n      requirement: REQ-9" in list_rules()
