"""Folders of sessions: numbered without gaps or collisions, the last few kept, and nothing of the user's ever touched."""

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path

import pytest

from pytest_rvads.report import folders
from pytest_rvads.report.folders import INDEX, KEPT, REPORT, claimed, option, run_file, sessions, used

LATE = 7200.0
"""Longer ago than any session that may still be running has written something [s]."""


def ended(root: Path, token: str, keep: int = KEPT) -> Path:
    """A session that came to its end."""
    folder = claimed(root, token, keep)
    for name in (INDEX, REPORT, "page.html", "page.svg"):
        (folder / name).write_text(token)
    run = run_file(folder, sha256(token.encode()).hexdigest())
    run.parent.mkdir(exist_ok=True)
    run.write_bytes(b"run")
    return folder


def names(root: Path) -> list[str]:
    return [folder.name for folder in sessions(root)]


def test_every_session_has_the_next_number(tmp_path: Path) -> None:
    root = tmp_path / "deep" / ".rvads"
    assert [ended(root, token).name for token in "abc"] == ["1", "2", "3"]
    assert (root / "latest").resolve() == (root / "3").resolve()
    assert (root / ".gitignore").read_text() == "*\n"
    assert {path.name for path in root.iterdir()} == {"1", "2", "3", "latest", ".gitignore"}


def test_the_processes_of_a_session_share_one(tmp_path: Path) -> None:
    assert claimed(tmp_path, "a", KEPT) == claimed(tmp_path, "a", KEPT) == tmp_path / "1"
    assert claimed(tmp_path, "b", KEPT) == tmp_path / "2"
    assert claimed(tmp_path, "a", KEPT) == tmp_path / "1"


def test_the_last_few_stay(tmp_path: Path) -> None:
    for token in "abcdefg":
        ended(tmp_path, token, keep=3)
    assert names(tmp_path) == ["5", "6", "7"]
    assert not (tmp_path / "4").exists()
    ended(tmp_path, "h", keep=1)
    assert names(tmp_path) == ["8"]


def test_ten_comes_after_nine(tmp_path: Path) -> None:
    for number in range(11):
        ended(tmp_path, str(number), keep=3)
    assert names(tmp_path) == ["9", "10", "11"]


def test_files_of_users_stay_in_the_folder(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "index.html").write_text("mine")
    root = tmp_path / ".rvads"
    root.mkdir()
    (root / ".gitignore").write_text("mine")
    (root / "notes.html").write_text("mine")
    (root / "2").mkdir()
    (root / "2" / "index.html").write_text("mine")
    (root / "3").symlink_to(outside)
    (root / "4").write_text("mine")
    (root / "007").mkdir()
    for token in "abcdefgh":
        ended(root, token, keep=1)
    assert names(root) == ["12"]
    assert (root / ".gitignore").read_text() == (root / "notes.html").read_text() == "mine"
    assert (root / "2" / "index.html").read_text() == (root / "3" / "index.html").read_text() == "mine"
    assert (root / "4").read_text() == "mine"
    assert (root / "007").is_dir()


def test_a_file_of_the_user_s_in_an_old_session_stays(tmp_path: Path) -> None:
    folder = ended(tmp_path, "a")
    (folder / "notes.txt").write_text("mine")
    (folder / "runs" / "mine").mkdir()
    (folder / "runs" / "mine" / "a.npz").write_text("mine")
    ended(tmp_path, "b", keep=1)
    assert [path.name for path in folder.iterdir() if path.is_file()] == ["notes.txt"]
    assert (folder / "runs" / "mine" / "a.npz").read_text() == "mine"
    assert ended(tmp_path, "c", keep=1).name == "3"


def test_links_are_removed_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "run.npz").write_text("mine")
    root = tmp_path / ".rvads"
    folder = claimed(root, "a", KEPT)
    (folder / REPORT).symlink_to(tmp_path / "precious" / "run.npz")
    (folder / "runs").symlink_to(tmp_path / "precious")
    ended(root, "b", keep=1)
    assert (tmp_path / "precious" / "run.npz").read_text() == "mine"
    assert names(root) == ["2"]


def test_a_name_of_the_user_s_is_no_link_to_the_latest(tmp_path: Path) -> None:
    (tmp_path / "latest").write_text("mine")
    assert ended(tmp_path, "a").name == "1"
    assert (tmp_path / "latest").read_text() == "mine"


def test_without_links_there_are_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError("a required privilege is not held by the client")

    monkeypatch.setattr(Path, "symlink_to", refused)
    assert ended(tmp_path, "a").name == "1"
    assert {path.name for path in tmp_path.iterdir()} == {"1", ".gitignore"}


def test_dead_sessions_are_removed_and_running_sessions_are_kept(tmp_path: Path) -> None:
    died = claimed(tmp_path, "a", KEPT)
    run_file(died, "0" * 64).parent.mkdir()
    ended(tmp_path, "b", keep=1)
    assert names(tmp_path) == ["1", "2"], "it has written something just now"
    then = died.stat().st_mtime - LATE
    for path in (died / "runs", died):
        os.utime(path, (then, then))
    ended(tmp_path, "c", keep=1)
    assert names(tmp_path) == ["3"]


def test_no_two_sessions_share_a_folder(tmp_path: Path) -> None:
    tokens = [f"session{number % 12}" for number in range(48)]
    with ThreadPoolExecutor(len(tokens)) as threads:
        found = list(threads.map(lambda token: claimed(tmp_path, token, 100), tokens))
    assert [folder.name for folder in sessions(tmp_path)] == [str(k) for k in range(1, 13)]
    assert {token: {f for t, f in zip(tokens, found, strict=True) if t == token} for token in tokens} == {
        token: {claimed(tmp_path, token, 100)} for token in tokens
    }
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".session")]


def test_processes_race_too(tmp_path: Path) -> None:
    code = "import sys, pathlib, pytest_rvads.report.folders as f; print(f.claimed(pathlib.Path(), sys.argv[1], 9))"
    started = [
        subprocess.Popen([sys.executable, "-c", code, token], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        for token in ("one", "two", "one", "two")
    ]
    found = [process.communicate()[0].strip() for process in started]
    assert found[0] == found[2]
    assert found[1] == found[3]
    assert sorted(set(found)) == ["1", "2"]


def test_dead_claim_of_a_folder_ends_the_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "_PAUSE", 0.0)
    (tmp_path / ".a").mkdir()
    with pytest.raises(OSError, match="another process of this session began to make a folder there and did not end"):
        claimed(tmp_path, "a", KEPT)
    assert claimed(tmp_path, "b", KEPT).name == "1"


def test_a_folder_that_can_t_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file"):
        claimed(tmp_path / "file", "a", KEPT)


def test_session_option_is_quoted_and_unique() -> None:
    assert option(Path(".rvads/12")) == "--session 12"
    assert option(Path("out/of the way/1")) == '--session "out/of the way/1"'
    assert option(Path(".rvads/latest")) == '--session ".rvads/latest"'
    assert option(Path("sub/.rvads/3")) == '--session "sub/.rvads/3"'
    assert option(Path("$(rm)/3")) == "--session '$(rm)/3'"


def test_what_runs_take_is_known(tmp_path: Path) -> None:
    folder = ended(tmp_path, "a")
    assert used(folder) == len(b"run")
    assert used(tmp_path / "nowhere") == 0


@pytest.mark.parametrize("damage", [lambda m: m.write_bytes(b"\xff\xfe"), lambda m: m.write_text("")], ids=["bytes", "empty"])
def test_a_damaged_marker_makes_no_trouble(tmp_path: Path, damage: Callable[[Path], object]) -> None:
    damage(ended(tmp_path, "a") / ".session")
    assert ended(tmp_path, "b", keep=1).name == "2"
    assert names(tmp_path) == ["2"]
