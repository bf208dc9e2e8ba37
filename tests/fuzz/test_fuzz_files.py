"""Every reader takes regular files of bounded size alone: nothing is waited for, and nothing without an end is read."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.logic.rules.book import load_rules
from pytest_rvads.runs.readers import read_recorded
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.support.errors import RvadsError

READERS: list[Callable[[Path], object]] = [read_map, load_rules, read_recorded, load_run]


def huge(path: Path) -> None:
    path.touch()
    os.truncate(path, 2**36)


@pytest.mark.parametrize(
    "put",
    [
        os.mkfifo,
        Path.mkdir,
        lambda path: path.symlink_to("/dev/zero"),
        lambda path: path.symlink_to(path),
        lambda path: None,
        huge,
    ],
    ids=["pipe", "folder", "without an end", "link to itself", "absent", "huge"],
)
@pytest.mark.parametrize("read", READERS)
def test_what_is_no_small_regular_file_is_refused(
    tmp_path: Path, put: Callable[[Path], object], read: Callable[[Path], object]
) -> None:
    path = tmp_path / "file"
    put(path)
    with pytest.raises(RvadsError, match=r"file") as caught:
        read(path)
    assert "\n" not in str(caught.value)
