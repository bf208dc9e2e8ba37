"""`rvads dynamics braking`: table, picture, JSON, and the closed loop of a named autopilot."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads import cli
from pytest_rvads.cli import dynamics_command as driving
from pytest_rvads.cli.common import progress
from pytest_rvads.report.svg import draw_braking
from pytest_rvads.simulators.driver_dynamics import closed_envelope
from pytest_rvads.support.errors import ScenarioError

SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.extended
def test_jobs_come_back_in_their_places_from_any_number_of_processes() -> None:
    one = closed_envelope("lgsvl", (0.01, 0.3), (1, 2), executor=1)
    assert one == closed_envelope("lgsvl", (0.01, 0.3), (1, 2), executor=2)
    assert [row[0] for row in one.values()] == [None, None], "I1"
    assert one[1][1] < one[2][1]


def test_an_unknown_autopilot_is_refused_before_any_run() -> None:
    with pytest.raises(ScenarioError, match=r"unknown autopilot 'referense', there are .* did you mean 'reference'"):
        closed_envelope("referense", (1.0,))


def test_the_command_names_the_nearest_autopilot(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dynamics", "braking", "--autopilot", "lsgvl"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "did you mean 'lgsvl'" in err


@pytest.mark.extended
def test_the_command_answers_for_an_autopilot(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(driving, "_DISTANCES", (0.01, 0.3))
    monkeypatch.setattr(driving, "_CURVE", (0.3, 10.0))
    monkeypatch.setenv("RVADS_CACHE", str(tmp_path / "cache"))
    picture = tmp_path / "lgsvl.svg"
    assert cli.main(["dynamics", "braking", "--autopilot", "lgsvl", "--json", "--svg", str(picture)]) == 0
    out, err = capsys.readouterr()
    assert err == "", "nothing but JSON"
    table = json.loads(out)
    assert [table[level]["0.01"] for level in "123"] == [None] * 3
    assert all(table[level]["0.3"] > 0 for level in "123")
    words = [node.text for node in ElementTree.parse(picture).getroot().iter(f"{SVG}text")]
    assert words.count("×") == 3
    assert cli.main(["dynamics", "braking", "--autopilot", "lgsvl"]) == 0
    out, err = capsys.readouterr()
    assert "  0.01          none          none          none" in out.splitlines()
    assert err.splitlines() == ["2/6 runs", "3/6 runs", "5/6 runs", "6/6 runs"], "a line per quarter, where nobody watches"


def test_on_a_terminal_a_bar_grows(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    for done in (1, 2):
        progress(done, 2)
    assert capsys.readouterr().err.split("\r")[1:] == [f"[{'#' * 20}{' ' * 20}] 1/2 runs", f"[{'#' * 40}] 2/2 runs\n"]


def test_a_curve_goes_through_its_points() -> None:
    curves = {level: [(0.0, 0.0), (10.0, 6.0), (20.0, 12.0)] for level in (1, 2, 3)}
    root = ElementTree.fromstring(draw_braking(curves, "title & more"))
    paths = [p.get("d") for p in root.iter(f"{SVG}path") if p.get("stroke-width") == "2"]
    assert len(paths) == 6, "three curves and their key"
    assert paths[0] == "M60.0 384.0L340.0 214.0L620.0 44.0"
    assert {n.text for n in root.iter(f"{SVG}text")} >= {"title & more", "aggression 1", "aggression 2", "aggression 3"}
