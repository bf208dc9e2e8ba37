"""Files are read within bounds and written whole, whatever lies there and whoever else writes."""

import os
import resource
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from pytest_rvads.support.storage import read_file, write_file


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "file"
    write_file(path, b"one")
    write_file(path, b"two")
    assert read_file(path, 3) == b"two"
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def test_pieces_are_written_atomically(tmp_path: Path) -> None:
    def pieces(last: int) -> Iterator[bytes]:
        yield b"one, "
        yield str(10 // last).encode()

    path = tmp_path / "file"
    write_file(path, pieces(5))
    assert path.read_bytes() == b"one, 2"
    with pytest.raises(ZeroDivisionError):
        write_file(path, pieces(0))
    assert path.read_bytes() == b"one, 2"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_too_large(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"four")
    with pytest.raises(OSError, match="too large, expected at most 3 bytes"):
        read_file(path, 3)


@pytest.mark.parametrize("name", ["pipe", "link", "folder"])
def test_no_regular_file_is_neither_waited_for_nor_read(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/zero")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match=r"regular file|directory"):
        read_file(tmp_path / name, 100)


@pytest.mark.parametrize("name", ["a\0b", "\ud800"])
def test_no_name_of_a_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(OSError, match="no file has such a name"):
        read_file(tmp_path / name, 100)


def test_a_name_of_any_length(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 250)
    write_file(path, b"")
    assert read_file(path, 0) == b""


def test_what_can_not_be_written_leaves_the_earlier_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_file(path, b"earlier")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))  # no file may be longer, as if the disk were full
    try:
        with pytest.raises(OSError, match="File too large"):
            write_file(path, [b"later" * 100] * 100)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert read_file(path, 100) == b"earlier"
    assert len(list(tmp_path.iterdir())) == 1


def test_device_is_written_in_place() -> None:
    write_file(Path("/dev/null"), b"gone")
    assert Path("/dev/null").is_char_device()


def test_unread_pipe_is_an_error(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="No such device"):
        write_file(tmp_path / "pipe", b"lost")


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_file(tmp_path / "link", b"through")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"through"


def test_many_writers_of_one_file_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "file"
    contents = [bytes([65 + k]) * 100_000 for k in range(4)]

    def write(content: bytes) -> None:
        for _ in range(20):
            write_file(path, content)
            assert read_file(path, 100_000) in contents

    threads = [threading.Thread(target=write, args=(content,)) for content in contents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
