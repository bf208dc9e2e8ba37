"""XML from elsewhere: every reader refuses what SECURITY.md says, in one sentence with the name of the file."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.satellites.openscenario.xosctree import read_tree
from pytest_rvads.satellites.tracks.lightlog import read_lights
from pytest_rvads.satellites.tracks.logformats import read_log
from pytest_rvads.support.boundedxml import DEEPEST, LONGEST_TAG
from pytest_rvads.support.errors import MapError, RunError

READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "town.xodr": ("OpenDRIVE", read_map),
    "tracks.xml": ("fcd-export", read_log),
    "lights.xml": ("tlsStates", read_lights),
    "drive.xosc": ("OpenSCENARIO", read_tree),
}
DECLARATIONS = {
    "nested entities": '<!DOCTYPE x [<!ENTITY a "haha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    "external entity": '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    "parameter entity": '<!DOCTYPE x [<!ENTITY % a SYSTEM "http://127.0.0.1/a.dtd"> %a;]>',
    "unparsed entity": '<!DOCTYPE x [<!NOTATION n SYSTEM "n"><!ENTITY a SYSTEM "file:///etc/passwd" NDATA n>]>',
    "external DTD": '<!DOCTYPE x SYSTEM "http://127.0.0.1/a.dtd">',
    "empty DTD": "<!DOCTYPE x>",
}


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
