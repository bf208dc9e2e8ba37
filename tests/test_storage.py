"""Files are read within bounds and written whole, whatever lies there; XML from elsewhere is refused as SECURITY.md says."""

import os
import resource
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.satellites.lanelet2.commonroad import read_commonroad
from pytest_rvads.satellites.lanelet2.lanelet_map import read_lanelet2
from pytest_rvads.satellites.openscenario.xosc import read_tree
from pytest_rvads.satellites.tracks.lightlog import read_lights
from pytest_rvads.satellites.tracks.logformats import read_log
from pytest_rvads.support.errors import MapError, RunError
from pytest_rvads.support.storage import DEEPEST, LONGEST_TAG, check_writable, read_file, write_file

READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "town.xodr": ("OpenDRIVE", read_map),
    "tracks.xml": ("fcd-export", read_log),
    "lights.xml": ("tlsStates", read_lights),
    "drive.xosc": ("OpenSCENARIO", read_tree),
    "lanelets.osm": ("osm", read_lanelet2),
    "scenario.xml": ("commonRoad", read_commonroad),
}
DECLARATIONS = {
    "nested entities": '<!DOCTYPE x [<!ENTITY a "haha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    "external entity": '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    "parameter entity": '<!DOCTYPE x [<!ENTITY % a SYSTEM "http://127.0.0.1/a.dtd"> %a;]>',
    "unparsed entity": '<!DOCTYPE x [<!NOTATION n SYSTEM "n"><!ENTITY a SYSTEM "file:///etc/passwd" NDATA n>]>',
    "external DTD": '<!DOCTYPE x SYSTEM "http://127.0.0.1/a.dtd">',
    "empty DTD": "<!DOCTYPE x>",
}


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "file"
    write_file(path, b"one")
    write_file(path, b"two")
    assert read_file(path, 3) == b"two"
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def test_path_that_takes_no_file_is_told_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"one")
    for fine in ("file", "new", "deep/deeper/new"):
        check_writable(tmp_path / fine)
    check_writable(Path("/dev/stdout"))
    for path, error in ((tmp_path, IsADirectoryError), (tmp_path / "file" / "new", NotADirectoryError)):
        with pytest.raises(error):
            check_writable(path)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("file", b"one")]


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
        with pytest.raises(OSError, match=f"File too large: '{path}'"):
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


@pytest.mark.parametrize("exists", [True, False])
def test_link_to_a_file_is_replaced_and_its_target_is_unchanged(tmp_path: Path, exists: bool) -> None:
    target, link = tmp_path / "file", tmp_path / "link"
    if exists:
        target.write_bytes(b"mine")
    link.symlink_to(target)
    check_writable(link)
    write_file(link, b"new")
    assert not link.is_symlink()
    assert link.read_bytes() == b"new"
    assert target.exists() is exists
    assert not exists or target.read_bytes() == b"mine"


def test_links_to_folders_and_devices_are_followed(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    write_file(tmp_path / "link" / "file", b"new")
    assert (tmp_path / "folder" / "file").read_bytes() == b"new"
    with pytest.raises(IsADirectoryError):
        write_file(tmp_path / "link", b"new")
    (tmp_path / "sink").symlink_to("/dev/null")
    write_file(tmp_path / "sink", b"gone")
    assert (tmp_path / "sink").is_symlink()


def test_standard_output_is_a_file_of_an_output(tmp_path: Path) -> None:
    code = "from pathlib import Path; from pytest_rvads.support.storage import write_file as w; w(Path('/dev/stdout'), b'page')"
    with (tmp_path / "out").open("wb") as out:
        subprocess.run([sys.executable, "-c", code], stdout=out, check=True)
    assert (tmp_path / "out").read_bytes() == b"page"
    assert Path("/dev/stdout").is_symlink()


@pytest.mark.parametrize("path", ["/dev/full", "/proc/rvads/page.html"])
def test_error_of_writing_names_the_path(path: str) -> None:
    with pytest.raises(OSError, match=f"'{path}'"):
        write_file(Path(path), b"lost" * 10_000)


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


def refusal(path: Path, content: str) -> str:
    """Return the sentence in which the reader of a file refuses a content; `ROOT` stands for the root element of the format."""
    root, read = READERS[path.name]
    path.write_text(content.replace("ROOT", root), encoding="utf-8")
    with pytest.raises((MapError, RunError)) as caught:
        read(path)
    message = str(caught.value)
    assert path.name in message
    assert "\n" not in message
    assert len(message) < 500
    return message


@pytest.mark.parametrize("declaration", DECLARATIONS.values(), ids=DECLARATIONS)
@pytest.mark.parametrize("name", READERS)
def test_document_type_declarations_are_refused(tmp_path: Path, name: str, declaration: str) -> None:
    message = refusal(tmp_path / name, f'<?xml version="1.0"?>{declaration}<ROOT a="&a;">&a;</ROOT>')
    assert "it has a document type declaration (DTD)" in message


@pytest.mark.parametrize("name", READERS)
def test_entities_without_declaration_are_refused(tmp_path: Path, name: str) -> None:
    assert "row 2, column 0: not XML: undefined entity" in refusal(tmp_path / name, "<ROOT>\n&a;</ROOT>")


@pytest.mark.parametrize("name", READERS)
def test_depth_is_bounded(tmp_path: Path, name: str) -> None:
    deepest = "<ROOT>\n" + "<a>" * (DEEPEST - 1) + "</a>" * (DEEPEST - 1)
    assert "the file is cut off" in refusal(tmp_path / name, deepest)
    assert f"row 2: elements are nested deeper than {DEEPEST} levels" in refusal(tmp_path / name, "<ROOT>\n" + "<a>" * DEEPEST)


@pytest.mark.parametrize("tag", ["<!--{}", '<a b="{}', "<a{}", "<?a {}"], ids=["comment", "attribute", "name", "instruction"])
@pytest.mark.parametrize("name", READERS)
def test_length_of_tags_is_bounded(tmp_path: Path, name: str, tag: str) -> None:
    tracemalloc.start()
    message = refusal(tmp_path / name, "<ROOT>\n" + tag.format("x" * (LONGEST_TAG + 1)))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "row 2: a tag or comment has more than 8 MB" in message
    assert peak < 8 * LONGEST_TAG


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("no XML", "row 1, column 0: not XML: syntax error; expected "),
        ("<ROOT>\n</road>", "row 2, column 2: not XML: mismatched tag; expected "),
        ("<ROOT>\n<a>", "row 2, column 3: not XML: no element found, the file is cut off; expected "),
        ('<?xml version="1.0" encoding="klingon"?><ROOT/>', "klingon"),
    ],
)
@pytest.mark.parametrize("name", READERS)
def test_files_without_xml_are_refused_with_the_place(tmp_path: Path, name: str, content: str, words: str) -> None:
    assert words in refusal(tmp_path / name, content)
