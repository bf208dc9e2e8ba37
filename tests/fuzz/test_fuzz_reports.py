"""Reports of whoever wrote them are read or refused in one sentence; in reports, pages and pictures, data stays data."""

import csv
import io
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from msgspec import structs

from pytest_rvads.cli.map_commands import draw_classes
from pytest_rvads.cli.report_commands import merge
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.report.files import FORMATS, load
from pytest_rvads.report.map_picture import draw_map
from pytest_rvads.report.record import Computing, conclude, planned_record
from pytest_rvads.report.scene import picture
from pytest_rvads.report.session_report import Change, Comparison, Report, cell_of
from pytest_rvads.report.terminal import summary
from pytest_rvads.runs.run import Fault, Run
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.satellites.pages.replay import Track, replay
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import printable

from .mutations import QUICK, damaged, hostile_text

_MARKUP = st.sampled_from(
    [
        *('"><img src=x onerror=alert(1)>', "</script><script>alert(1)</script>", "</text></svg><svg onload='alert(1)'>", "<!--"),
        *("[x](javascript:alert(1))", "[x]: javascript:alert(1)", "![x](http://x.org/y)", "<javascript:alert(1)>", "www.x.org"),
        *("a | b", "`", "``|`", "\\", "\\|", "a\nb", "\n# x", "$x$", "**x**", "_x_", "~~x~~", "&lt;", "&#60;b>", "@everybody"),
        *("\t=1", " '=cmd|' /C calc'!A0", "+1", "-1+1", "\r@x", "＝1", "${data}", "$data", "[/]", "[red]x", "a" * 300, "\ufffe"),
    ]
)
TEXTS = hostile_text | _MARKUP | st.builds("".join, st.lists(_MARKUP, max_size=3))


@cache
def run() -> Run:
    return simulate(Case(Scenario(find("light4"), "1132", distance=0.3, duration=2.0), LgsvlLike))


@cache
def report() -> Report:
    """Two items of a run, one known to fail, with all that a report can hold."""
    records = []
    for rule, known in (("p1", None), ("p6", "I3: order")):
        cell = {"junction": "light4", "cls": 7, "scenario": "1132", "cfg": "B", "rotation": 0, "rule": rule, "driver": "a.B"}
        start = planned_record(f"t.py::test[{rule}]", 3, "test", cell, 4, ("REQ-1",))
        verdict = check(run(), rule)
        over = conclude(start, [verdict], "call", "failed", known=known, text=verdict.message)
        timing = {"a1": Computing(stack="stack ./mine", decisions=60, compute=0.3, longest=0.02)}
        look, looks = ".rvads/a.html#t=1.00", (".rvads/b.html#t=2.00",)
        records.append(structs.replace(over, run="r", hash=rule, look=look, looks=looks, kpis=kpis(run()), timing=timing))
    comparison = Comparison("main.json", (Change("NEW", records[0].nodeid, "p1"), Change("LOST", "gone")), ("numpy was 1",))
    cells = tuple(map(cell_of, records))
    return Report(tuple(records), {4: (24, 81)}, cells, {"numpy": "2"}, 1, ("a note",), {"test": 2}, {"r": 1.5}, comparison)


class Elements(HTMLParser):
    """What a browser makes of a page: its elements with their attributes, and what stands in scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, tuple[tuple[str, str | None], ...]]] = []
        self.raw: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, tuple(attributes)))

    def handle_data(self, data: str) -> None:
        if self.cdata_elem:
            self.raw.append(data)

    @property
    def kinds(self) -> set[tuple[str, tuple[str, ...]]]:
        """Elements with the names of their attributes."""
        return {(tag, tuple(name for name, _ in attributes)) for tag, attributes in self.elements}

    @property
    def data(self) -> Any:
        """What the script of the page is given."""
        return json.loads(self.raw[1])

    @property
    def own(self) -> tuple[str, str]:
        """Style and script."""
        style, _, script = self.raw
        return style, script


@cache
def plain(form: str) -> str:
    return written(form, report())


def written(form: str, found: Report) -> str:
    return "".join(FORMATS[form](found, Path(".rvads")))


def is_number(cell: str) -> bool:
    return re.fullmatch(r"[-+]?[\d.]+", cell) is not None


def is_link(target: str) -> bool:
    """Tell whether browsers take a text for a relative path or an address of the web."""
    if target.startswith("https://"):
        return True
    relative = not re.match(r"[^/?#]*:|\s*//", target)
    return relative and not re.search(r"[\\\x00-\x1f\x7f]", target)


def data_stays_data(found: Report) -> None:
    """Assert that no form of a report has more in it than the same form of a tame one but text."""
    for form in FORMATS:
        written(form, found).encode()
    page, tame = Elements(written(".html", found)), Elements(plain(".html"))
    assert set(page.elements) <= {*tame.elements, ("p", (("class", "note"),)), ("li", ()), ("div", (("id", "sums"),))}
    assert page.own == tame.own
    assert len(page.data["items"]) == len(found.records)
    assert all(is_link(item["look"]) for item in page.data["items"])
    assert all(is_link(link) for item in page.data["items"] for link in item["more"])
    rows = list(csv.reader(io.StringIO(written(".csv", found))))
    assert len({len(row) for row in rows}) == 1
    assert [cell for row in rows for cell in row if re.match(r"[\s\"]*[=+\-@＝＋－＠]", cell) and not is_number(cell)] == []
    assert markdown_tokens(written(".md", found)) <= markdown_tokens(plain(".md")) | {"hr"}  # an empty note
    shown = summary(found, colour=False, width=80, unicode=True, full=True)
    assert set(shown) & set("\x00\x07\x08\r\x1b\x7f\x9b\u202e\u2066\ud800") == set()


def markdown_tokens(text: str) -> set[str]:
    """What Markdown makes of a text, with bare addresses and tables as GitHub reads them."""
    tokens = MarkdownIt("commonmark").enable(["table", "strikethrough"]).parse(text)
    return {token.type for outer in tokens for token in (outer, *(outer.children or ()))}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reports")


def read(path: Path, content: bytes) -> Report | str:
    """Read a report, or say why it can't be."""
    path.write_bytes(content)
    try:
        return load(path)
    except RvadsError as refused:
        return str(refused)


@pytest.mark.extended
@QUICK
@given(content=st.deferred(lambda: damaged(plain(".json").encode())))
def test_a_damaged_report_is_read_or_refused_in_one_sentence(folder: Path, content: bytes) -> None:
    found = read(folder / "shard.json", content)
    if isinstance(found, Report):
        data_stays_data(found)
        data_stays_data(merge([("one", found), ("other", report())]))
    else:
        assert found.startswith(str(folder / "shard.json"))
        assert "\n" not in found
        assert len(found) < 1000


def with_texts(value: Any, texts: Iterator[str], key: str = "") -> Any:
    """Return JSON with other texts in the place of all that may be any text; rules keep their names, which occur twice."""
    if isinstance(value, dict):
        return {name: with_texts(inner, texts, name) for name, inner in value.items()}
    if isinstance(value, list):
        return [with_texts(inner, texts, key) for inner in value]
    return next(texts) if isinstance(value, str) and key not in ("type", "status", "format", "outcome", "rule") else value


@pytest.mark.extended
@QUICK
@given(texts=st.lists(TEXTS, min_size=1, max_size=4))
def test_a_report_full_of_hostile_texts_is_shown_as_texts(folder: Path, texts: list[str]) -> None:
    content = with_texts(json.loads(plain(".json")), (texts[n % len(texts)] for n in range(10**6)))
    found = read(folder / "texts.json", json.dumps(content).encode())
    if isinstance(found, Report):
        data_stays_data(found)
    else:
        assert re.search("[\ud800-\udfff]", "".join(texts)), "JSON holds every text but halves of characters"


@pytest.mark.extended
@QUICK
@given(text=TEXTS)
def test_sums_over_junctions_with_hostile_names_are_shown_as_texts(text: str) -> None:
    names = [f"{text}{number}" for number in range(6)]
    records = (structs.replace(one, junction=name, control=text, rule=text) for name in names for one in report().records)
    data_stays_data(replace(report(), records=tuple(records)))


def svg(text: str) -> set[tuple[str, tuple[str, ...]]]:
    """The elements of a picture with the names of their attributes; it is well-formed."""
    return {(element.tag, tuple(element.attrib)) for element in ET.fromstring(text).iter()}


def pictures(text: str) -> tuple[str, ...]:
    """Pictures of an instant, a map and classes, and a replay, with a text wherever there is one; no line of notes is a table."""
    agents = tuple(replace(agent, name=f"{text}{agent.name}") for agent in run().agents)
    one = replace(run(), label=text, agents=agents, collisions=None, fault=Fault(1.0, "a0", text))
    road_map = read_map(path_of("stop4"))
    notes = re.sub("^ +", "", text, flags=re.MULTILINE)
    reports = tuple(replace(junction, id=text) for junction in road_map.junctions)
    unusable = tuple(replace(junction, reason=text) for junction in reports)
    return (
        picture(one, 50, text, {agents[0].name}),
        draw_map(replace(road_map, path=text, junctions=(*reports, *unusable))),
        draw_classes(4, text, [(text, [(1, 1, 3, 3)])]),
        replay(
            one,
            text,
            notes,
            [(0.5, text)],
            [Track(text, ((0, "watching"), (50, "due")))],
            {agents[1].name},
        ),
    )


@cache
def _tame() -> tuple[str, ...]:
    return pictures("x")


@pytest.mark.extended
@QUICK
@given(text=TEXTS)
def test_pictures_and_replays_show_hostile_names_as_texts(text: str) -> None:
    *drawn, page = pictures(text)
    *tame, other = _tame()
    for one, expected in zip(drawn, tame, strict=True):
        assert svg(one) == svg(expected)
    assert svg(page[page.index("<svg") : page.index("</svg>") + 6]) == svg(other[other.index("<svg") : other.index("</svg>") + 6])
    assert Elements(page).kinds == Elements(other).kinds
    assert Elements(page).own == Elements(other).own
    assert Elements(page).data["agents"] == [printable(f"{text}a{n}", 10**6) for n in range(4)]
