"""Strips of the atlas: bands along an axis of time, their labels, hints and ticks. Curves of the dynamics of a driver."""

import re
from html import unescape
from itertools import pairwise
from xml.etree import ElementTree

import pytest

from pytest_rvads.report.svg import draw_dynamics
from pytest_rvads.satellites.starts.all_lines import Band, StripRow, _page, draw_strips


def drawn(*rows: StripRow) -> ElementTree.Element:
    return ElementTree.fromstring(draw_strips(rows, -6.0, 6.0, "lead & more"))


def band(first: float, last: float, label: str = "", *, faint: bool = False) -> Band:
    return Band(first, last, "bad", faint, label, "why <it> failed")


def test_widths_of_bands_are_proportional_to_their_time() -> None:
    root = drawn(StripRow("0->1", "note", [band(-6.0, 6.0)], []), StripRow("0->2", "", [band(-6.0, 0.0), band(0.0, 3.0)], []))
    whole, left, right = ([float(rect.attrib[key]) for key in ("x", "width", "y")] for rect in root.iter("rect"))
    assert (left[1], right[1]) == (whole[1] / 2, whole[1] / 4)
    assert left[0] == whole[0]
    assert right[0] == left[0] + left[1]
    assert left[2] == right[2] > whole[2], "rows go down"


def test_axis_has_a_label_per_second() -> None:
    words = [node.text for node in drawn().iter("text")]
    assert words == ["lead & more", *(f"{second:+d} s" for second in range(-6, 7))]


def test_band_has_its_mark_its_hint_and_a_label_if_there_is_room() -> None:
    root = drawn(StripRow("a", "b", [band(-6.0, 0.0, "wide enough"), band(0.0, 0.1, "too narrow", faint=True)], []))
    assert [rect.attrib["class"] for rect in root.iter("rect")] == ["band bad", "band bad faint"]
    assert [title.text for title in root.iter("title")] == ["why <it> failed"] * 2
    words = [node.text for node in root.iter("text")]
    assert "wide enough" in words
    assert "too narrow" not in words


def test_label_stands_above_its_strip_and_over_the_whole_width() -> None:
    """Beside the strips, the labels would take two thirds of a phone."""
    root = drawn(StripRow("0->1", "all-way stop", [band(-6.0, 6.0)], []), StripRow("0->2", "", [band(-6.0, 6.0)], []))
    labels = [node for node in root.iter("text") if node.attrib.get("class") == "label"]
    assert ["".join(node.itertext()) for node in labels] == ["0->1 all-way stop", "0->2 "]
    bands = list(root.iter("rect"))
    tops = [float(node.attrib["y"]) for pair in zip(labels, bands, strict=True) for node in pair]
    assert tops == sorted(tops)
    wide = float(root.attrib["viewBox"].split()[2])
    assert float(bands[0].attrib["width"]) > 0.9 * wide


def test_page_says_what_the_colours_mean() -> None:
    names = dict.fromkeys(("junction", "driver", "simulator", "summary"), "x")
    page = _page([{**names, "rules": ["p1"], "groups": []}])
    assert all(f"{colour}: " in page for colour in ("Green", "Orange", "Yellow", "Full colour", "Faint colour"))


def test_hostile_names_are_texts_on_the_page_of_an_atlas() -> None:
    def page(text: str) -> str:
        piece = {"from": -6.0, "to": 6.0, "order": text, "status": "FAIL", "rule": text, "rerun": text}
        strip = {"title": text, "decided_by": text, "pieces": [piece], "simulated": [], "unfit": "", "error": text}
        names = dict.fromkeys(("junction", "driver", "simulator", "pedestrians", "summary"), text)
        return _page([{**names, "rules": [text], "groups": [[strip]]}])

    hostile = "</li></text><script>alert(1)</script><img src=x onerror=alert(2)>\"' \x1b[2J"
    shown, tame = page(hostile), page("tame")
    assert re.findall("<[a-zA-Z/][^ >]*", shown) == re.findall("<[a-zA-Z/][^ >]*", tame)
    assert "\x1b" not in shown
    assert unescape(shown).count("<script>alert(1)") == tame.count("tame")


def test_ticks_lie_below_the_ends_of_a_band() -> None:
    root = drawn(StripRow("a", "b", [band(-1.5, 2.5)], [-1.5, 2.5]))
    (rect,) = root.iter("rect")
    (path,) = (node.attrib["d"] for node in root.iter("path") if node.attrib["class"] == "ticks")
    left, right = (float(x) for x in re.findall(r"M([\d.]+) ", path))
    assert left == pytest.approx(float(rect.attrib["x"]))
    assert right == pytest.approx(float(rect.attrib["x"]) + float(rect.attrib["width"]), abs=0.11)


def test_labels_of_curves_that_end_close_to_each_other_do_not_overlap_and_axes_have_round_ticks() -> None:
    times = {v: [(60.0, 5.0 + 0.05 * v)] for v in (0.0, 2.0, 4.0, 6.0)}
    root = ElementTree.fromstring(draw_dynamics([(10.0, 13.6)], times, "title"))
    texts = [(node.text or "", float(node.attrib["x"]), float(node.attrib["y"])) for node in root.findall(".//{*}text")]
    rows = sorted(y for text, _, y in texts if text.startswith("from "))
    assert len(rows) == 4
    assert min(below - above for above, below in pairwise(rows)) >= 11.0
    ticks = [text for text, _, _ in texts if re.fullmatch(r"[\d.]+", text)]
    assert ticks.count("0") == 4, "every axis begins at 0"
    assert {"16", "12", "8", "4"} <= set(ticks), "the axis of 13.6 m ends at 16 m"
    assert all(len(tick) <= 4 for tick in ticks)


def test_dynamics_leave_out_what_never_happens() -> None:
    """A driver that never stops has no curve B, and a distance that it does not reach has no point of AT."""
    stops, never = [(2.0, 1.0), (4.0, 4.0)], [(2.0, float("inf")), (4.0, float("inf"))]
    times = {0.0: [(10.0, 4.0), (20.0, float("inf"))]}
    curves = [
        re.findall(r'd="([^"]*)"[^>]*stroke-width="2"', draw_dynamics(braking, times, "title")) for braking in (stops, never)
    ]
    assert [[len(re.findall("[ML]", curve)) for curve in drawing] for drawing in curves] == [[2, 2], [2]]
