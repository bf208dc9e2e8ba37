"""Recorded runs that drive backwards, go on after a crash, leave something out, or were touched up, and what is told of them."""

import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.runs.states import Colour

from .byhand import CROSS, GREEN, joined, until_contact
from .cases import BROKEN, told, verdicts
from .shown import shows

Make = Callable[..., rvads.Run]
ME = {"subject": "a0"}


def broken(run: rvads.Run) -> dict[str, str]:
    """Return the rules of the road that a run does not keep, with who is to blame."""
    return {rule: text for rule, text in verdicts(run).items() if text.split()[0] in BROKEN}


@shows("reverse_away")
def test_reversing_away_is_not_getting_on(drive: Make) -> None:
    run = drive("light4", {0: (2, -10.0, [(0, -1.0)])}, 1200, GREEN, **ME)
    assert broken(run) == {"progress": "FAIL a0"}


@shows("to_and_fro_inside")
def test_driving_to_and_fro_in_the_junction_is_no_progress(drive: Make) -> None:
    """3 s forwards and 3 s back, at 2 m/s, for half a minute: it moves all the time and gets nowhere."""
    there_and_back = [(300 * k, 2.0 if k % 2 == 0 else -2.0) for k in range(2, 12)]
    run = drive("light4", {0: (2, -10.0, [(0, 5.0), *there_and_back])}, 3600, GREEN, **ME)
    assert broken(run) == {"progress": "FAIL a0"}


@shows("too_fast_backwards")
def test_the_limit_counts_backwards(drive: Make) -> None:
    run = drive("light4", {0: (2, -10.0, [(0, -12.0)])}, 300, GREEN, **ME)
    assert broken(run) == {"speed_limit": "FAIL a0"}


@shows("drive_on_after_a_crash")
def test_driving_on_does_not_undo_a_crash(drive: Make) -> None:
    """a1 runs the red light, touches a0, and both drive on to their exits."""
    vehicles = {0: (2, -0.5, [(0, 0.0), (100, 8.0)]), 1: (2, -10.0, [(0, 8.0)])}
    run = drive("light4", vehicles, 900, CROSS, [(250, "a0", "a1")], subject="a1")
    assert (run.zone[-1] == rvads.Zone.EXIT).all()
    assert broken(run).items() >= {"red": "FAIL a1", "no_collision": "FAIL a1"}.items()
    assert rvads.check(run, "no_collision").final


@shows("cut_in_on_the_exit_road")
def test_who_cuts_in_is_not_run_into_from_behind(drive: Make) -> None:
    """a1 came first and goes straight on into exit 3; a2 turns right into it, with hardly any room, and slows down at once."""
    first = (2, -0.5, [(0, 0.0), (300, 6.0)])
    second = (1, -3.0, [(0, 1.0), (250, 0.0), (428, 8.0), (640, 2.0)])
    run = until_contact(drive("stop4", {1: first, 2: second}, 1200, subject="a2"))
    verdict = rvads.check(run, "no_collision")
    assert told(verdict) == "FAIL a2"
    assert "cut in ahead of a1" in verdict.explanation


@shows("reverse_into_who_follows")
def test_who_reverses_is_not_run_into_from_behind(drive: Make) -> None:
    """The subject backs at 2 m/s into another vehicle, which rolls towards it at 0.3 m/s."""
    ahead = drive("light4", {0: (2, -10.0, [(0, -2.0)])}, 600, GREEN, **ME)
    run = until_contact(joined(ahead, drive("light4", {0: (2, -20.0, [(0, 0.3)])}, 600, GREEN)))
    assert verdicts(run)["no_collision"] == "FAIL a0"


@shows("two_bodies_in_one_place")
def test_bodies_in_one_place_have_collided(drive: Make) -> None:
    """Whoever recorded the run did not say whether anybody collided; both drive through the middle at the same time."""
    run = replace(drive("stop4", {0: (2, -10.0, [(0, 8.0)]), 1: (2, -10.0, [(0, 8.0)])}, 600), collisions=None)
    assert told(rvads.check(run, "no_collision")).split()[0] == "FAIL"


@shows("crash_struck_out")
def test_a_crash_struck_out_is_seen_in_the_poses(drive: Make) -> None:
    """The recording says that nobody collided, and has two bodies in one place: that is a crash, or at least a finding."""
    run = drive("stop4", {0: (2, -10.0, [(0, 8.0)]), 1: (2, -10.0, [(0, 8.0)])}, 600)
    assert run.collisions == ()
    assert told(rvads.check(run, "no_collision")).startswith("FAIL") or rvads.validate(run)


@shows("without_positions")
def test_rules_about_unrecorded_quantities_are_na(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 100, 400), 1: (2, 10, 100, 400)}, 600)
    for rule in ("full_stop", "no_collision", "no_conflict", "keep_clear", "progress", "keep_lane", "on_route", "speed_limit"):
        verdict = rvads.check(run, rule)
        assert (verdict.status, verdict.reason.partition(":")[0]) == ("NA", "not recorded")


@shows("empty_run")
def test_an_empty_run_is_an_error(drive: Make) -> None:
    whole = drive("stop4", {0: (2, -10.0, [(0, 8.0)])}, 10)
    empty = replace(whole, **{name: getattr(whole, name)[:0] for name in ("zone", "lights", "station", "speed", "pose")})
    assert set(verdicts(empty).values()) == {"ERROR"}
    assert told(rvads.check(empty, "p1")) == "ERROR"


@shows("nan_in_the_run")
def test_a_run_with_a_hole_is_an_error(drive: Make) -> None:
    """It speeds for a second, in which its speeds are not numbers."""
    run = drive("stop4", {0: (2, -10.0, [(0, 8.0)])}, 300)
    speed = run.need("speed").copy()
    speed[100:200] = np.nan
    holed = replace(run, speed=speed)
    assert set(verdicts(holed).values()) == {"ERROR"}


@shows("subject_that_is_not_there")
def test_absent_subject_is_an_error(drive: Make) -> None:
    """Whoever ran the sign was a0, and the recording says that a9 was to be tested."""
    run = drive("stop4", {0: (2, -10.0, [(0, 8.0)])}, 300, subject="a9")
    assert set(verdicts(run).values()) == {"ERROR"}


@shows("two_by_one_name")
def test_two_vehicles_by_one_name_are_an_error(drive: Make) -> None:
    """Both are called a0; the one behind drives into the other one, and nobody can tell which of them was to be tested."""
    ahead = drive("light4", {0: (2, -10.0, [(0, 2.0)])}, 400, GREEN, **ME)
    run = until_contact(joined(ahead, drive("light4", {0: (2, -20.0, [(0, 8.0)])}, 400, GREEN)))
    both = replace(run, agents=(run.agents[0], run.agents[0]))
    assert set(verdicts(both).values()) == {"ERROR"}


@shows("straight_on_called_a_right_turn")
def test_turn_follows_from_the_path_and_not_from_its_label(drive: Make) -> None:
    """a1 stops at red and goes straight on; the recording calls that a right turn, for which it need not wait."""
    run = drive("light4", {1: (2, -0.5, [(0, 0.0), (200, 8.0)])}, 600, CROSS, subject="a1")
    assert verdicts(run)["red"] == "FAIL a1"
    way = replace(run.junction.movements[run.agents[0].way.key], turn=rvads.values.Turn.RIGHT)
    renamed = replace(run, agents=(replace(run.agents[0], way=way),))
    assert verdicts(renamed)["red"] in ("FAIL a1", "ERROR")


@shows("speeds_set_to_zero")
def test_standing_still_at_eight_metres_per_second_is_doubted(
    drive: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """a0 runs the sign; its speeds are all zero, as if it had stood there all the time."""
    run = drive("stop4", {0: (2, -10.0, [(0, 8.0)])}, 500)
    still = replace(run, speed=np.zeros_like(run.need("speed")))
    assert {finding.kind for finding in rvads.validate(still)} == {"progress"}
    rvads.files.save_run(still, tmp_path / "still.npz")
    main(["check", str(tmp_path / "still.npz"), "--rules", "full_stop"])
    assert "warning: " in capsys.readouterr().err


@shows("violation_cut_out")
def test_what_was_cut_out_is_missed(drive: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """a0 runs the sign; the states from before the entrance zone until it is on the exit road are gone."""
    run = drive("stop4", {0: (2, -10.0, [(0, 8.0)])}, 800)
    keep = (run.need("station")[:, 0] < -2.0) | (run.need("station")[:, 0] > 36.0)
    cut = replace(run, **{name: getattr(run, name)[keep] for name in ("zone", "lights", "station", "speed", "pose")})
    assert "jump" in {finding.kind for finding in rvads.validate(cut)}
    rvads.files.save_run(cut, tmp_path / "cut.npz")
    assert main(["check", str(tmp_path / "cut.npz"), "--rules", "full_stop"]) != 0
    assert "a0 jumps on the graph" in capsys.readouterr().err


@shows("light_painted_green")
def test_a_light_out_of_order_is_found(drive: Make) -> None:
    """The light is green for the half second in which a1 enters, and red before and after."""
    lights = {**CROSS, 1: [(0, Colour.RED), (120, Colour.GREEN), (170, Colour.RED)]}
    run = drive("light4", {1: (2, -10.0, [(0, 8.0)])}, 300, lights, subject="a1")
    assert [finding.kind for finding in rvads.validate(run)] == ["colour"]


@shows("vehicles_made_thin")
def test_other_sizes_are_another_run(drive: Make, tmp_path: Path) -> None:
    """In the file of a kept run the vehicles are made so thin that nothing touches, which its hash betrays."""
    run = drive("stop4", {0: (2, -10.0, [(0, 8.0)]), 2: (2, -10.0, [(0, 8.0)])}, 300)
    rvads.files.save_run(run, tmp_path / "run.npz")
    with zipfile.ZipFile(tmp_path / "run.npz") as file:
        entries = {name: file.read(name) for name in file.namelist()}
    header = entries["header.npy"]
    assert header.count(b'"size": [4.6, 1.86]') == 2
    entries["header.npy"] = header.replace(b"1.86", b"0.10")
    with zipfile.ZipFile(tmp_path / "thin.npz", "w") as file:
        for name, content in entries.items():
            file.writestr(name, content)
    thin = rvads.files.load_run(tmp_path / "thin.npz")
    assert [agent.size for agent in thin.agents] == [(4.6, 0.1)] * 2
    assert rvads.files.load_run(tmp_path / "run.npz").hash == run.hash != thin.hash


@shows("nothing_applies")
def test_check_without_an_applicable_rule_is_no_success(drive: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rvads.files.save_run(drive("stop4", {0: (2, -10.0, [(0, 8.0)])}, 800), tmp_path / "run.npz")
    assert main(["check", str(tmp_path / "run.npz"), "--rules", "p4", "--rules", "red"]) == 5
    assert "nothing was judged" in capsys.readouterr().err
    assert json.loads((main(["check", str(tmp_path / "run.npz"), "--rules", "red", "--json"]), capsys.readouterr().out)[1]) == {
        "version": 1,
        "by-hand": {"red": {"status": "NA", "violated": [], "unsure": []}},
    }
