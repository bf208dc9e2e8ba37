"""`rvads init`: what it writes runs at once, says what to do next, and changes nothing that is there."""

import shutil
import sys
from pathlib import Path

import pytest

from pytest_rvads.cli import main
from pytest_rvads.cli.first_commands import WORKFLOW
from pytest_rvads.geometry.opendrive.map_file import path_of
from tools.crossings import Layout, opendrive

ROOT = Path(__file__).parents[2]
DRIVES = ROOT / "examples" / "drives"


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    assert main(["init", *arguments]) == 0
    return capsys.readouterr().out.splitlines()


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["init", *arguments]) == 2
    out, err = capsys.readouterr()
    assert not out
    assert len(err.splitlines()) == 1
    return err


@pytest.mark.extended
def test_first_session_fails_by_four_rules_the_first_of_which_is_mended_in_the_file(
    pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = told(capsys)
    assert lines[:3] == ["wrote conftest.py", "wrote test_rules.py", "next: pytest"]
    result = pytester.runpytest()
    assert result.parseoutcomes() == {"passed": 52, "failed": 6, "skipped": 15}
    result.stdout.fnmatch_lines(["E *full_stop at t=* s: a0 entered the junction before it had stopped at the line"])
    for rule in ("first_come", "right_first", "yield_sign"):
        result.stdout.fnmatch_lines([f"E *{rule} at t=* s: a0 *"])
    result.stdout.fnmatch_lines(["driven by conftest.MyController*"])

    conftest = pytester.path / "conftest.py"
    text = conftest.read_text("utf-8")
    better = text.replace("if occupied and before else 5.0", "if before and (occupied or not self.stood(seen)) else 5.0")
    better = better.replace(
        "    def target_speed",
        """    has_stood = False

    def stood(self, seen):
        self.has_stood = self.has_stood or (seen.me.speed < 0.05 and seen.me.station > -1.5)
        return self.has_stood

    def target_speed""",
    )
    conftest.write_text(better, "utf-8")
    result = pytester.runpytest("-k", "full_stop")
    assert result.parseoutcomes() == {"passed": 5, "deselected": 68}


def test_files_go_into_a_folder_that_is_made(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys, "my rules/first")
    assert "next: cd 'my rules/first' && pytest" in lines
    assert sorted(path.name for path in Path("my rules/first").iterdir()) == ["conftest.py", "test_rules.py"]


@pytest.mark.parametrize("name", ["conftest.py", "test_rules.py"])
def test_nothing_that_exists_is_changed(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str], name: str) -> None:
    Path(name).write_text("mine", "utf-8")
    assert f"{name} exists and is not changed, nothing was written" in refused(capsys)
    assert {path.name: path.read_text("utf-8") for path in pytester.path.iterdir()} == {name: "mine"}


def test_a_link_that_leads_nowhere_exists_too(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    Path("conftest.py").symlink_to("elsewhere.py")
    assert "conftest.py exists" in refused(capsys)
    assert [path.name for path in pytester.path.iterdir()] == ["conftest.py"]


@pytest.mark.extended
def test_a_stack_drives_from_the_folder_of_the_tests(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    Path("rules").mkdir()
    for name in ("example.py", "rvads_client.py"):
        shutil.copy(ROOT / "clients" / "python" / name, "rules")
    lines = told(capsys, "rules", "--sut", f"{sys.executable} example.py --fast")
    assert not any("There is no program" in line for line in lines)
    result = pytester.runpytest("rules")  # from another folder than that of the program
    assert result.parseoutcomes() == {"passed": 59, "skipped": 14}
    result.stdout.fnmatch_lines(["driven by stack *example.py --fast*"])


def test_a_stack_that_is_not_there_yet_is_told(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys, "rules", "--sut", "./stack")
    assert "There is no program at rules/stack yet: put it there first." in lines
    assert "There is no program on the PATH yet: put it there first." in told(capsys, "more", "--sut", "no-such-program-here -x")


def test_a_stack_that_lies_here_is_found(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(sys.executable, "stack")
    assert not any("There is no program" in line for line in told(capsys, "--sut", "./stack"))


@pytest.mark.extended
@pytest.mark.parametrize(("name", "grid", "first"), [("light3", "('S42', 'S53')", "H"), ("stop3", "('S21', 'S46')", "C")])
def test_a_map_is_driven_at_its_first_junction(
    pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str], name: str, grid: str, first: str
) -> None:
    """Found from the tests, wherever pytest is started; lights are red for somebody."""
    shutil.copy(path_of(name), "mine.xodr")
    told(capsys, "rules", "--map", "mine.xodr")
    text = Path("rules/test_rules.py").read_text("utf-8")
    assert '"map": \'../mine.xodr\', "subject": "all"' in text
    assert f'cover="conflicts", grid={grid}' in text
    assert f"scenarios=('100', '200', '010', '020', '001', '002'), grid='{first}'" in text
    result = pytester.runpytest("rules", "-k", "as122")
    outcomes = result.parseoutcomes()
    assert outcomes["passed"] > outcomes["failed"] > 0
    assert "errors" not in outcomes


def test_a_junction_of_a_map_may_be_named(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(path_of("stop4"), "mine.xodr")
    told(capsys, "--map", "mine.xodr", "--junction", "1")
    assert "@rvads.scenario('1', " in Path("test_rules.py").read_text("utf-8")
    assert "has no junction '7'" in refused(capsys, "other", "--map", "mine.xodr", "--junction", "7")


@pytest.mark.parametrize(
    ("name", "fault"), [("stop3", "stop sign"), ("light3", "red light"), ("right4", "let pass"), ("yield4", "let pass")]
)
def test_the_controller_says_what_it_does_wrong_at_this_junction(
    pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str], name: str, fault: str
) -> None:
    shutil.copy(path_of(name), "mine.xodr")
    told(capsys, "--map", "mine.xodr")
    text = Path("conftest.py").read_text("utf-8")
    assert [words for words in ("stop sign", "red light", "let pass") if words in text] == [fault]
    assert "$" not in text


@pytest.mark.extended
def test_movements_that_no_car_can_follow_are_left_out_and_counted(
    pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]
) -> None:
    """Right turns have a radius of 1.25 m there, in lanes of 2.5 m."""
    Path("mine.xodr").write_text(opendrive(Layout(stop=2.5, lane_width=2.5, lane_offset=1.25)), encoding="utf-8")
    told(capsys, "--map", "mine.xodr")
    result = pytester.runpytest("-k", "keep_lane", "--collect-only", "-q")
    codes = {line.partition("-as")[2][:4] for line in result.outlines if "-as" in line}
    assert codes
    assert not any("1" in code for code in codes)
    result = pytester.runpytest("-k", "keep_lane", "--rvads-sample=1")
    result.stdout.fnmatch_lines(["4 movements left out: no car can keep its lane in a bend so narrow *"])


def test_recordings_are_judged_and_nothing_drives(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(DRIVES, "drives")
    told(capsys, "rules", "--recordings", "drives/*.npz")
    assert [path.name for path in Path("rules").iterdir()] == ["test_rules.py"]
    result = pytester.runpytest("rules")
    assert result.parseoutcomes() == {"passed": 13, "failed": 1, "skipped": 6}
    result.stdout.fnmatch_lines(["FAILED *rolls-full_stop*"])


def test_paths_stand_in_the_tests_as_python_writes_them(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    name = "a'\"\\ $map\n)x.npz"
    shutil.copy(DRIVES / "stops.npz", name)
    told(capsys, "--recordings", name)
    assert pytester.runpytest("-k", "full_stop").parseoutcomes() == {"passed": 1, "deselected": 9}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--recordings", "nowhere.npz"], "nowhere.npz does not exist"),
        (["--recordings", "tracks.csv"], "rvads import tracks.csv --map MAP.xodr --junction ID -o runs.npz"),
        (["--map", "nowhere.xodr"], "nowhere.xodr does not exist"),
        (["--map", "tracks.csv"], "tracks.csv"),
        (["--junction", "7"], "--junction names a junction of --map"),
        (["--recordings", "x.npz", "--map", "x.xodr"], "leave out --map or --recordings"),
        (["--ci", "github", "--map", "x.xodr"], "leave out --map or --ci"),
        (["--sut", " "], "--sut is the command of your program"),
        (["--sut", "'"], "--sut can't be read as a command"),
        (["tracks.csv"], "tracks.csv"),
    ],
)
def test_what_can_t_be_started_from_is_told_and_nothing_is_written(
    pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    Path("tracks.csv").write_text("x,y\n", "utf-8")
    assert says in refused(capsys, *arguments)
    assert [path.name for path in pytester.path.iterdir()] == ["tracks.csv"]


def test_the_workflow_is_written_alone(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys, "--ci", "github")
    assert lines[0] == f"wrote {WORKFLOW}"
    assert [path.name for path in pytester.path.iterdir()] == [".github"]
    assert f"{WORKFLOW} exists" in refused(capsys, "--ci", "github")
