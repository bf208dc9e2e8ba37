"""The tables as text, picture and command."""

import json
import re
from xml.etree import ElementTree

import pytest

from pytest_rvads import cli
from pytest_rvads.satellites.paper.tables import (
    TABLES,
    Key,
    disagreements,
    entries,
    published,
    svg_tables,
    text_sweep,
    text_tables,
)


@pytest.fixture
def verdicts() -> dict[Key, str]:
    """As published, and FAIL where the paper says nothing."""
    keys = (entry.key(rule) for table in TABLES for entry in entries(table) for rule in table.rules)
    return {key: published().get(key, "FAIL") for key in keys}


def test_row_has_the_layout_of_the_paper(verdicts: dict[Key, str]) -> None:
    lines = text_tables(verdicts).splitlines()
    (row,) = (line for line in lines if "0d1 1d1 2d2 3d1" in line)
    assert re.findall(r"Fail|Pass|NA", row) == ["Fail", "Fail", "NA"] * 2 + ["Pass", "Fail", "NA"] * 2 + ["Pass", "Fail", "Pass"]
    assert "!" not in text_tables(verdicts)


def test_disagreement_is_marked_and_listed(verdicts: dict[Key, str]) -> None:
    key = (1, 2, "C", "p1")
    verdicts[key] = "FAIL"
    assert disagreements(verdicts) == [(key, "FAIL", "PASS")]
    shown = text_tables(verdicts)
    assert shown.count("Fail!") == 1
    assert "class 1 row 3 C p1: FAIL, published PASS" in shown
    assert "119 of 120" in shown


def test_picture_has_every_cell(verdicts: dict[Key, str]) -> None:
    root = ElementTree.fromstring(svg_tables(verdicts))
    words = [node.text for node in root.iter("{http://www.w3.org/2000/svg}text")]
    assert sum(word in ("Fail", "Pass", "NA") for word in words) == 240


def test_shares_have_the_order_fail_pass_na() -> None:
    shown = text_sweep({(4, 0, "J", "p5"): {"FAIL": 0.03, "PASS": 0.15, "NA": 0.82}})
    assert "class 4  0d2 1d1 2d2 3d1  J  p5  3/15/82" in shown


def test_command_prints_only_json(
    verdicts: dict[Key, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: object
) -> None:
    monkeypatch.setattr("pytest_rvads.satellites.paper.tables.compute", lambda *_, **__: verdicts)
    assert cli.main(["paper", "--json", "--svg", f"{tmp_path}/tables.svg"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["stop4"]["class1"]["row3"]["C"] == {"p1": "PASS", "p2": "FAIL", "p3": "NA"}
    verdicts[1, 2, "C", "p1"] = "FAIL"
    assert cli.main(["paper"]) == 1
