"""Files that cannot be used: one error of one sentence each, in bounded time and memory."""

import time
import tracemalloc
from pathlib import Path

import pytest

from pytest_rvads.geometry.opendrive import map_file as document
from pytest_rvads.geometry.opendrive.map_file import MAX_BYTES
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.support.errors import MapError
from tools.crossings import Layout, opendrive

from .conftest import Read


def refusal(read: Read, content: str | bytes) -> str:
    with pytest.raises(MapError) as caught:
        read(content)
    message = str(caught.value)
    assert message.startswith("map file /")
    assert "\n" not in message
    assert len(message) < 500
    return message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("no XML", "row 1, column 0: not XML: syntax error; expected an OpenDRIVE file (.xodr)"),
        (b"\x00\xff\x00", "not XML"),
        ("<OpenDRIVE><road>", "is cut off"),
        ("<OpenDRIVE></road>", "not XML: mismatched tag"),
        ("<!-- only a comment", "is cut off"),
        ("<svg/>", "its root element is <svg>, expected <OpenDRIVE>"),
        ("<OpenDRIVE/>", "0 roads but no <junction>"),
        ('<?xml version="1.0" encoding="klingon"?><OpenDRIVE/>', "klingon"),
        ("<OpenDRIVE><road/></OpenDRIVE>", "no id"),
        ('<OpenDRIVE><road id="7"/></OpenDRIVE>', "road '7': <road> has no attribute 'length'"),
        ('<OpenDRIVE><junction id="7"/><junction id="7"/></OpenDRIVE>', "two junctions with id '7'"),
    ],
)
def test_sentences(read: Read, content: str | bytes, words: str) -> None:
    assert words in refusal(read, content)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400", "1e13", "x", "0x10"])
@pytest.mark.parametrize("attribute", ["x", "hdg", "length"])
def test_text_in_place_of_a_number_is_refused(read: Read, attribute: str, value: str) -> None:
    text = opendrive(Layout())
    at = text.index(f' {attribute}="', text.index("<geometry")) + len(attribute) + 3
    message = refusal(read, text[:at] + value + text[text.index('"', at) :])
    assert "road '0'" in message
    assert repr(value) in message


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"nowhere.xodr does not exist; give the path of an OpenDRIVE file"):
        read_map(tmp_path / "nowhere.xodr")
    with pytest.raises(MapError, match="is not a regular file"):
        read_map(tmp_path)
    with pytest.raises(MapError, match=r"cannot be read|does not exist"):
        read_map("a\0b")


def test_too_large(tmp_path: Path) -> None:
    path = tmp_path / "large.xodr"
    with path.open("wb") as stream:
        stream.truncate(MAX_BYTES + 1)
    with pytest.raises(MapError, match="more than the 128 MB that are read"):
        read_map(path)


def test_deep_nesting_is_left_early(tmp_path: Path) -> None:
    path = tmp_path / "deep.xodr"
    path.write_bytes(b"<OpenDRIVE>" + b"<a>" * 30_000_000)
    tracemalloc.start()
    began = time.process_time()
    with pytest.raises(MapError, match="deeper than 60 levels"):
        read_map(path)
    took, (_, peak) = time.process_time() - began, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert took < 2
    assert peak < 20_000_000


@pytest.mark.parametrize("length", ["1e6", "1e11"])
def test_absurd_lengths(read: Read, length: str) -> None:
    assert "km long, expected at most 200 km" in refusal(
        read, opendrive(Layout()).replace('length="120"', f'length="{length}"', 1)
    )


def test_too_many_samples(read: Read) -> None:
    text = opendrive(Layout()).replace('length="120"', 'length="190000"').replace("<line />", '<arc curvature="0.00001" />')
    assert "samples" in refusal(
        read,
        text.replace(
            "</OpenDRIVE>", text[text.index("<road") : text.index("<junction")].replace('id="', 'id="x') + "</OpenDRIVE>"
        ),
    )


def test_links_to_itself(read: Read) -> None:
    ends = [
        f'<{tag} elementType="road" elementId="0" contactPoint="{end}"/>'
        for tag, end in (("predecessor", "end"), ("successor", "start"))
    ]
    link = f"<link>{''.join(ends)}</link>"
    text = opendrive(Layout())
    start = text.index("<link>")
    (report,) = read(text[:start] + link + text[text.index("</link>") + 7 :]).junctions
    assert max(report.approach) < 1000


@pytest.mark.parametrize("share", [0.01, 0.2, 0.5, 0.9, 0.999])
def test_truncated_real_files(shared: Path, read: Read, share: float) -> None:
    for stem in ("sumo_t3", "cubetown", "Town01"):
        data = (shared / "maps" / f"{stem}.xodr").read_bytes()
        assert "is cut off" in refusal(read, data[: int(len(data) * share)])


def test_more_elements_than_a_town_can_have(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document, "MAX_ELEMENTS", 1000)
    assert "more than 1,000 elements" in refusal(read, "<OpenDRIVE>" + "<x/>" * 1000 + "</OpenDRIVE>")


@pytest.mark.parametrize("id", ["x" * 1001, "a\x9bb", "a&#10;b"], ids=["long", "control", "line"])
def test_long_ids_and_control_characters_are_refused(read: Read, id: str) -> None:
    text = opendrive(Layout()).replace('<junction id="1"', f'<junction id="{id}"')
    assert "the id of <junction> must have at most 1,000 characters and no control characters, got" in refusal(read, text)


@pytest.mark.slow
def test_as_many_elements_as_are_read_take_seconds(read: Read) -> None:
    lane = '<right><lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane></right>'
    road = (
        '<road id="{0}" length="9" junction="-1"><planView><geometry s="0" x="{0}0" y="0" hdg="0" length="9"><line/></geometry>'
        f'</planView><lanes><laneSection s="0">{lane}</laneSection></lanes></road>'
    )
    roads = "".join(map(road.format, range(document.MAX_ELEMENTS // 10)))
    began = time.process_time()
    assert len(read(f'<OpenDRIVE>{roads}<junction id="1"/></OpenDRIVE>').junctions) == 1
    assert time.process_time() - began < 20


def test_endless_tags_and_comments(read: Read) -> None:
    assert "a tag or comment has more than 8 MB" in refusal(read, "<OpenDRIVE><!--" + "-x" * 5_000_000)
    assert "a tag or comment has more than 8 MB" in refusal(
        read, "<OpenDRIVE><road " + " ".join(f'a{i}="1"' for i in range(800_000)) + "/>"
    )


def test_work_is_bounded_before_it_is_done(read: Read) -> None:
    lane = '<right><lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane></right>'
    sections = "".join(f'<laneSection s="{k / 1000}">{lane}</laneSection>' for k in range(8_000))
    pieces = "".join(f'<geometry s="{k / 1000}" x="0" y="0" hdg="0" length="1"><line/></geometry>' for k in range(8_000))
    road = f'<road id="1" length="100" junction="-1"><planView>{pieces}</planView><lanes>{sections}</lanes></road>'
    assert "samples, more than 1,500,000" in refusal(read, f'<OpenDRIVE>{road}<junction id="1"/></OpenDRIVE>')
