"""The page of a session leads to the replays; pytest-html gets the pictures."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import pytest

FAILING = """
import pytest_rvads as rvads
import pytest

@pytest.fixture
def rvads_autopilot():
    return rvads.RollingStop

# Who came first does not matter to it.
@rvads.scenario("stop4", classes=7, distances=(10, 11, 12, 13), rules=("p1", "p3"))
def test_rules(run, rule, monitor):
    monitor.check(rule)
"""


def content(page: Path) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*)</script>', page.read_text(encoding="utf-8"))
    assert found
    read: dict[str, Any] = json.loads(found[1])
    return read


@pytest.mark.parametrize("workers", ["-n0", "-n1"])
def test_the_index_links_every_failure_to_its_replay(pytester: pytest.Pytester, workers: str) -> None:
    pytester.makepyfile(FAILING)
    result = pytester.runpytest(workers, "--rvads-report=out/verdicts.html")
    result.stdout.fnmatch_lines(["look: .rvads/1/index.html"])
    for page in (pytester.path / ".rvads" / "1" / "index.html", pytester.path / "out" / "verdicts.html"):
        items = content(page)["items"]
        assert len(items) == 2
        failed = [item for item in items if item["status"] == "FAIL"]
        assert failed
        for item in failed:
            target, _, time = item["look"].partition("#t=")
            assert (page.parent / target).resolve().is_file()
            assert f"t={time} s" in item["text"]


def test_the_replay_shows_the_monitors_and_the_vehicle_to_blame(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    pytester.runpytest("-k", "p3")
    (page,) = (pytester.path / ".rvads" / "1").glob("*p3.html")
    run = content(page)
    assert run["responsible"]
    assert "violated" in {word for _, changes in run["tracks"] for _, word in changes}
    assert {label.split()[0] for label, _ in run["tracks"]} == {"p3"}


def test_without_artefacts_there_is_no_page(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    result = pytester.runpytest("--rvads-artefacts=none", "-k", "p1")
    result.stdout.no_fnmatch_line("look*")
    assert not (pytester.path / ".rvads").exists()


def test_pytest_html_gets_the_picture(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pytest_html")
    monkeypatch.delenv("PYTEST_ADDOPTS")  # by which tests/conftest.py puts it away
    pytester.makepyfile(FAILING)
    pytester.runpytest("-k", "p3", "--html=report.html", "--self-contained-html")
    (drawn,) = (pytester.path / ".rvads" / "1").glob("*p3.svg")
    assert base64.b64encode(drawn.read_bytes()).decode() in (pytester.path / "report.html").read_text(encoding="utf-8")
