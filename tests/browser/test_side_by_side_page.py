"""The page of two sessions works in a browser, on a phone too, and executes nothing that came with the reports."""

from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.record import conclude, planned_record
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.side_by_side import save, side_by_side

HOSTILE = "<img src=x onerror=document.title=1> </script><b>v1"


def session(*failing: int) -> Report:
    records = []
    for cls in range(1, 25):
        keys = {"junction": "stop4", "cls": cls, "scenario": "1111", "cfg": "C", "rotation": 0, "rule": f"p{cls}"}
        start = planned_record(f"t.py::test[{HOSTILE}-{cls}]", 3, "test", {**keys, "variant": HOSTILE}, 4)
        status, outcome = ("FAIL", "failed") if cls in failing else ("PASS", "passed")
        records.append(conclude(start, [Verdict("", Status(status), "", violated=HOSTILE)], "call", outcome, text=HOSTILE))
    return Report(tuple(records), command=HOSTILE)


@pytest.mark.parametrize("width", [375, 1280])
def test_a_comparison_is_shown_as_text_and_fits(browser: Any, tmp_path: Path, width: int) -> None:
    path = tmp_path / "out.html"
    save(path, side_by_side([(HOSTILE, session(1)), ("new.json", session(*range(2, 25)))]))
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
    )
    browser.get(f"file://{path}")
    assert browser.title == "rvads: sessions side by side"
    assert browser.find_elements("css selector", "img, b") == []
    titles = [one.text for one in browser.find_elements("tag name", "h2")]
    assert titles[:2] == [f"A: {HOSTILE}", "B: new.json"]
    assert {"stop4 t.py::test: 24 of 24 cells differ", "NEW: 23 items", "FIXED: 1 item"} <= set(titles)
    shown = [one.text for one in browser.find_elements("css selector", "td.good, td.bad")]
    assert [shown.count(text) for text in ("FAIL -> pass", "pass -> FAIL")] == [1, 23]
    more = browser.find_element("css selector", "details")
    assert more.text == "13 more lines"
    more.click()
    assert len(more.find_elements("tag name", "li")) == 13
    assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth"), (
        "tables scroll, not the page"
    )
    assert browser.get_log("browser") == []
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
