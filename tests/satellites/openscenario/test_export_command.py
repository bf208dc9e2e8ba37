"""``rvads export`` writes runs and scenarios."""

from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main

from .failures import FAILURES, TRUCK

pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture
def saved_run(maps: Path, tmp_path: Path) -> Path:
    """The file of a run at a junction of a map file, with a truck in it."""
    scenario = rvads.Scenario(rvads.find("1", maps / "left.xodr"), "2200", distance=1.0, duration=5.0)
    case = rvads.Case(scenario, rvads.LgsvlLike, fleet=rvads.Fleet(others={"a1": TRUCK}))
    rvads.files.save_run(rvads.simulate(case), tmp_path / "kept.npz")
    return tmp_path / "kept.npz"


def test_exported_run_quotes_its_verdict(saved_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out" / "run.xosc"
    assert main(["export", str(saved_run), "-o", str(out), "--rules", "p2"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"{out}: 2 vehicles at left.1, 5.00 s\n  p2")
    assert (out.parent / "left.xodr").is_file()
    assert f': {text.splitlines()[1].strip()}"' in out.read_text("utf-8")[:3000]


def test_scenario_of_a_run_is_exported_with_its_bodies(saved_run: Path, tmp_path: Path) -> None:
    assert main(["export", str(saved_run), "--scenario", "-o", str(tmp_path / "s.xosc")]) == 0
    run = rvads.files.load_run(saved_run)
    scenario = rvads.files.load_scenario(tmp_path / "s.xosc")
    assert (scenario.name, scenario.duration) == (run.label, 5.0)
    assert 'vehicleCategory="truck"' in (tmp_path / "s.xosc").read_text("utf-8")


@pytest.mark.parametrize("id", ["stop4-class07-as1133-cfgD", "stop4-class07-as1133-cfgD.r1-p1", "light4-class00-as0200-s1-cfgJ"])
def test_case_is_exported_as_its_scenario(id: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", id, "-o", str(tmp_path / "s.xosc")]) == 0
    scenario = rvads.files.load_scenario(tmp_path / "s.xosc")
    assert f"{id}-".startswith(f"{scenario.name}-")
    assert scenario.name in capsys.readouterr().out


def test_case_at_a_junction_of_a_file_needs_its_map(maps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    id, out = "five.1-class000-as20000-cfgC", str(tmp_path / "s.xosc")
    assert main(["export", id, "-o", out]) == 2
    assert "unknown junction 'five.1'" in capsys.readouterr().err
    assert main(["export", id, "-o", out, "--map", str(maps / "five.xodr")]) == 0
    assert rvads.files.load_scenario(out).place.name == "five.1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "'nothing' is no id of a scenario, expected such as 'stop4-class07-as1133-cfgD'"),
        (["none.npz"], "none.npz: can't be read"),
        (["NONE.NPZ"], "NONE.NPZ: can't be read"),
        (["stop4-class07-as1133-cfgD", "--rules", "p1"], "leave --rules out"),
        (["none.npz", "--scenario", "--rules", "p1"], "leave --rules out"),
    ],
)
def test_misuse_of_export_is_one_line(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", *arguments, "-o", "out.xosc"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("rvads: ")
    assert message in error
    assert error.count("\n") == 1
    assert not Path("out.xosc").exists()


def test_export_requires_a_single_simulated_run(maps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rvads.files.export_run(FAILURES[3].run(maps), tmp_path / "run.xosc")
    out = str(tmp_path / "out.xosc")
    assert main(["export", str(tmp_path / "run.xosc"), "--scenario", "-o", out]) == 2
    assert "run.xosc: the run names no scenario" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "run.xosc"), "-o", out]) == 0
    recording = rvads.files.read_tracks(tmp_path / "run.xosc")
    from dataclasses import replace

    later = tuple(
        replace(track, times=track.times + 100.0, agent=replace(track.agent, name=f"{track.agent.name} later"))
        for track in recording.tracks
    )
    rvads.files.save_recording(replace(recording, tracks=recording.tracks + later), tmp_path / "several.npz")
    assert main(["export", str(tmp_path / "several.npz"), "-o", out]) == 2
    assert "several.npz: the file has 2 runs" in capsys.readouterr().err
