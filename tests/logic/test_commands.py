"""Judging files of runs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.cli.answers import check_runs, doubts, list_rules, named_rules
from pytest_rvads.errors import FormulaError, RunError
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import save_run
from pytest_rvads.runs.states import Zone

Make = Callable[..., Run]


def test_runs_are_judged_by_name(make: Make) -> None:
    one = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 250, 300)}, 400)
    two = replace(make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 150, 300)}, 400), label="other")
    found = check_runs([one, two])
    assert {label: {n: str(v.status) for n, v in verdicts.items()} for label, verdicts in found.items()} == {
        "by-hand": {"p1": "PASS", "p2": "FAIL", "p3": "NA", "p4": "NA", "p5": "NA", "p6": "NA"},
        "other": {"p1": "FAIL", "p2": "NA", "p3": "PASS", "p4": "NA", "p5": "NA", "p6": "NA"},
    }
    assert list(check_runs([one], ["p2", "no_collision"])["by-hand"]) == ["p2", "no_collision"]
    with pytest.raises(RunError, match="2 runs are called 'by-hand'"):
        check_runs([one, one])
    with pytest.raises(FormulaError, match="unknown rule 'p9'"):
        check_runs([one], "p9")


def test_files_are_read_by_their_kind(make: Make, tmp_path: Path) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 400)
    save_run(run, tmp_path / "run.npz")
    (back,) = read_runs(tmp_path / "run.npz")
    assert back.hash == run.hash
    (tmp_path / "runs.json").write_text("[]")
    with pytest.raises(RunError, match="must be an object"):
        read_runs(tmp_path / "runs.json")
    with pytest.raises(RunError, match=r"expected a file of runs \(.json, .npz\), got one ending in '.csv'"):
        read_runs(tmp_path / "runs.csv")


def test_names_of_rules_add_up(tmp_path: Path) -> None:
    (tmp_path / "own.rules").write_text("[mine]\ntext = forall a. F a@j\nrequirement = REQ-9\n")
    names = [r.name for r in named_rules([str(tmp_path / "own.rules"), "p6", "paper"])]
    assert names == ["mine", "p6", "p1", "p2", "p3", "p4", "p5"]
    assert "\n      requirement: REQ-9" in list_rules()


def test_doubts_name_the_run(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 400)
    zone = run.zone.copy()
    zone[300:] = Zone.APPROACH
    broken = replace(run, zone=zone, label="back")
    assert doubts([run]) == []
    assert doubts([run, broken]) == ["back: a0 jumps on the graph at 3.00 s: from exit to approach in one step"]
    assert np.array_equal(run.zone[:300], broken.zone[:300])
