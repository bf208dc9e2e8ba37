"""The session page and Markdown, as they are written: what stands first, what is folded, what can be pasted, what can be read."""

import json
import re
from html import unescape
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from markdown_it import MarkdownIt
from msgspec.structs import replace

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.files import markdown, save
from pytest_rvads.report.folders import claimed
from pytest_rvads.report.outline import Changes, outline
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.session_report import Change, Comparison, Report
from pytest_rvads.report.terminal import summary
from pytest_rvads.satellites.pages.page import page
from pytest_rvads.session.outputs import annotate
from pytest_rvads.support import installed
from pytest_rvads.support.errors import RvadsError

LONG = "d10.00,12.50v05.00,08.33"


def record(cls: int, rule: str, status: str, cfg: str = LONG) -> Record:
    keys: dict[str, Any] = {"junction": "stop4", "cls": cls, "scenario": "1111", "cfg": cfg, "rotation": 0, "rule": rule}
    made = planned_record(f"t.py::test[stop4-class{cls:02d}-cfg{cfg}-{rule}]", 3, "test", keys, 4)
    made = replace(made, hash=f"{cls} {cfg}", driver="mine.Pilot", source="pilots.py 3fa29c01", simulator="bullet")
    outcome = {"PASS": "passed", "NA": "skipped"}.get(status, "failed")
    return conclude(made, [Verdict("", Status(status), "", violated="both in")], "call", outcome, text=f"{rule} at t=1.00 s")


def session(*records: Record, **more: Any) -> Report:
    return Report(records, {4: (24, 81)}, exitstatus=1, began="2026-11-23T12:46:18+00:00", command="pytest -q", **more)


ONE = session(record(1, "p1", "FAIL"), record(2, "p1", "PASS"), record(2, "p2", "NA"))


def content(report: Report) -> Any:
    (data,) = re.findall('id="data">(.*)</script>', page(report, Path(".rvads")))
    return json.loads(data)


def colours() -> dict[str, dict[str, str]]:
    """By theme the colours that the style of the page names."""
    (style,) = re.findall("<style>(.*?)</style>", page(ONE, Path()), re.DOTALL)
    themes = {"light": r":root\{([^}]*)\}", "dark": r":root\[data-theme=dark\]\{([^}]*)\}"}
    found = {name: "".join(re.findall(pattern, style)) for name, pattern in themes.items()}
    return {name: dict(re.findall(r"--(\w+):(#\w+)", blocks)) for name, blocks in found.items()}


def contrast(one: str, other: str) -> float:
    """The contrast ratio of two colours (WCAG 2.2, 1.4.3), from 1 to 21."""

    def luminance(colour: str) -> float:
        digits = colour.removeprefix("#")
        pairs = [2 * digit for digit in digits] if len(digits) == 3 else re.findall("..", digits)
        parts = [int(pair, 16) / 255 for pair in pairs]
        red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    dark, light = sorted(map(luminance, (one, other)))
    return (light + 0.05) / (dark + 0.05)


def test_contrast_matches_the_wcag_formula() -> None:
    assert contrast("#000", "#ffffff") == pytest.approx(21)
    assert contrast("#767676", "#fff") == pytest.approx(4.54, abs=0.01), "the least grey that passes on white"


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_texts_can_be_read_in_both_themes(theme: str) -> None:
    named = colours()[theme]
    for text, ground in product(("fg", "faint", "link"), ("bg", "soft")):
        assert contrast(named[text], named[ground]) >= 4.5, f"{text} on {ground}"
    assert contrast(named["bad"], named["bg"]) >= 4.5, "a failure in a table"
    for mark in ("good", "bad", "error", "doubt", "none", "faint"):
        assert contrast(named[mark], named["bg"]) >= 3, f"{mark}, which is no text"


def test_no_colour_of_the_page_is_outside_its_themes() -> None:
    style = files("pytest_rvads.satellites.pages").joinpath("page.css").read_text(encoding="utf-8")
    outside = re.sub(r"--\w+:#\w+", "", style)
    assert re.findall(r"#[0-9a-f]{3,6}\b(?=[;}])", outside) == []


def test_a_page_begins_with_what_the_session_was() -> None:
    text = page(ONE, Path())
    terms = re.findall("<dt>(.*?)</dt><dd>(.*?)</dd>", text)
    assert terms == [
        ("began", "2026-11-23T12:46:18+00:00"),
        ("command", "pytest -q"),
        ("result", "3 verdicts on 2 runs: 1 pass, 1 fail, 1 NA"),
        ("exit status", "1"),
        ("driven by", "mine.Pilot (pilots.py 3fa29c01): 2 runs"),
        ("simulated by", "bullet: 2 runs"),
    ]
    places = [text.index(part) for part in ("<dl class=head>", "id=causes", 'id="failures"', 'id="folded"') if part in text]
    assert places == sorted(places)


def test_many_drivers_are_folded_and_none_is_left_out() -> None:
    drivers = [replace(record(cls, "p1", "FAIL"), driver=f"Pilot{cls}") for cls in range(1, 31)]
    text = page(session(*drivers), Path())
    shown, _, folded = text[: text.index("<script")].partition("<details>")
    assert len(re.findall("<dt>", shown)) == 10
    assert "<dt>exit status</dt>" in shown
    assert folded.startswith("<summary>25 more</summary>")
    assert set(re.findall(r"Pilot\d+", text[: text.index("<script")])) == {f"Pilot{cls}" for cls in range(1, 31)}


def test_changes_since_a_baseline_stand_before_the_causes_and_many_are_folded() -> None:
    changes = tuple(Change("NEW", f"t{number}") for number in range(15))
    text = page(session(comparison=Comparison("main.json", changes)), Path())
    shown, _, folded = text.partition("<details>")
    assert "against main.json: 15 NEW" in shown
    assert (shown.count("<li>"), folded.startswith("<summary>5 more</summary>")) == (10, True)


def test_the_page_of_a_session_names_it_in_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    one = replace(record(1, "p1", "FAIL"), look="")
    claimed(Path(".rvads"), "token", 5)
    told = f'"draw":"rvads replay --session 1 \\"{one.nodeid}\\""'
    for folder in (Path(".rvads/1"), tmp_path / ".rvads/1", Path(".rvads/latest")):
        assert told in page(session(one), folder)
    assert "--session" not in page(session(one), Path(".rvads")), "of what lies elsewhere nobody knows the session"


@pytest.mark.parametrize(
    ("look", "status", "kept", "command"),
    [
        ("", "FAIL", "", True),
        ("not drawn: ValueError: no ink", "FAIL", "", True),
        (".rvads/a.html#t=1.00", "FAIL", "", False),
        ("", "PASS", "", False),
        ("", "PASS", "runs", True),
        ("", "ERROR", "", False),
    ],
)
def test_item_without_a_replay_names_the_drawing_command(look: str, status: str, kept: str, command: bool) -> None:
    one = replace(record(1, "p1", status), look=look)
    (item,) = content(session(one, kept=kept))["items"]
    assert item["draw"] == (f'rvads replay "{one.nodeid}"' if command else "")
    assert bool(item["look"]) == look.startswith(".rvads")
    (none,) = content(session(replace(one, hash=None, look="")))["items"]
    assert none["draw"] == "", "there is nothing to draw"
    (town,) = content(session(replace(one, look=""), kept=kept, again="rvads town T.xodr --only"))["items"]
    assert town["draw"] == "", "its replays are its own"


@pytest.mark.parametrize("name", ["t.py::test[$(touch owned)]", "t.py::test[`id`]", 't.py::test["; id; "]', "t.py::test[a b!\\]"])
def test_pasted_command_quotes_hostile_names(name: str) -> None:
    report = session(replace(record(1, "p1", "FAIL"), nodeid=name), comparison=Comparison("main.json", (Change("NEW", name),)))
    found = content(report)
    (item,), ((cause,), *_) = found["items"], [block["causes"] for block in found["causes"]]
    assert item["draw"] == f"rvads replay '{name}'"
    assert cause["again"] == f"pytest '{name}'"
    blocks = outline(report)
    assert [block.first for block in blocks if isinstance(block, Changes)] == [f"pytest '{name}'"]
    assert any(line.endswith(f"(first: pytest '{name}')") for block in blocks for line in block.plain())
    assert f"first: pytest '{name}'" in summary(report, colour=False, width=200, unicode=True)
    (annotation,) = annotate(report, Path("/repo"), Path("/repo"))
    assert annotation.endswith(f"%0Arerun: pytest '{name}'")
    shown = [token.content for token in MarkdownIt().enable("table").parse(markdown(report)) if token.type == "inline"]
    assert any(unescape(re.sub(r"[`\\]", "", text)) == re.sub(r"[`\\]", "", f"'{name}'") for text in shown)


def test_markdown_tells_what_the_session_was_and_the_causes_and_folds_the_rest() -> None:
    text = markdown(ONE)
    shown = re.sub(r"<details>.*?</details>\n", "", text, flags=re.DOTALL)
    assert shown.splitlines() == [
        "# rvads verdicts",
        "",
        "- began 2026-11-23T12:46:18+00:00",
        "- command: pytest -q",
        "- 3 verdicts on 2 runs: 1 pass, 1 fail, 1 NA",
        "- exit status 1",
        "- driven by mine.Pilot (pilots.py 3fa29c01): 2 runs",
        "- simulated by bullet: 2 runs",
        "",
        "## Causes of failures",
        "",
        "| items | rule | cause | first: pytest |",
        "|---:|---|---|---|",
        f'| 1 | p1 | both in | `"t.py::test[stop4-class01-cfg{LONG}-p1]"` |',
        "",
        "",
        "",
    ]
    assert re.findall("<summary>(.*)</summary>", text) == [
        "verdict tables",
        "not applicable, skipped or not run",
        "coverage and figures",
    ]
    assert text.count("<details>") == text.count("</details>") == 3


def test_numbers_stand_for_long_configurations_in_markdown() -> None:
    text = markdown(session(record(1, "p1", "FAIL"), record(1, "p1", "PASS", "B"), record(1, "p2", "PASS", "e" + LONG)))
    # The word joiner keeps GitHub from taking a number for that of an issue.
    assert "| class | B p1 | \\#\u20601 p1 | \\#\u20602 p2 |" in text
    assert f"- \\#\u20601 = {LONG}\n- \\#\u20602 = e{LONG}\n" in text
    tokens = MarkdownIt().enable("table").parse(text)
    assert sum(token.type == "table_open" for token in tokens) == 2, "causes and verdicts"


HOSTILE = ["a | b", "</details><script>x</script>", "</summary>", "`x` | `", "\n\n# head", "\n| a |\n|---|\n", "<!--", "@all #1"]


@pytest.mark.parametrize("text", HOSTILE)
def test_nothing_breaks_the_tables_or_the_folds_of_markdown(text: str) -> None:
    one = replace(record(1, text, "FAIL", cfg=text * 9), driver=text, source=text, simulator=text, junction=text, message=text)
    quiet = replace(record(2, text, "NA", cfg=text * 9), message=text)
    comparison = Comparison(text, (Change("NEW", text),))
    report = Report((one, quiet), versions={text: text}, notes=(text,), began=text, command=text, comparison=comparison)
    rendered = markdown(report)
    plain = markdown(session(record(1, "p1", "FAIL"), record(2, "p1", "NA"), versions={"a": "b"}, comparison=comparison))
    kinds = ("table_open", "th_open", "td_open", "html_block", "html_inline", "heading_open")
    parsed = [MarkdownIt().enable("table").parse(form) for form in (rendered, plain)]
    flat = [[t for token in tokens for t in (token, *(token.children or ()))] for tokens in parsed]
    counts = [{kind: sum(token.type == kind for token in tokens) for kind in kinds} for tokens in flat]
    assert counts[0]["html_inline"] == 0
    assert counts[0]["html_block"] == counts[1]["html_block"]
    assert "\n- began " in rendered


def test_page_links_to_critical_starts_in_the_folder_of_artefacts(tmp_path: Path) -> None:
    folder = tmp_path / ".rvads" / "3"
    folder.mkdir(parents=True)
    assert "critical starts" not in page(ONE, folder)
    (tmp_path / ".rvads" / "critical.html").touch()
    assert '<a href="../critical.html">critical starts</a>' in page(ONE, folder)


def test_without_the_pages_a_sentence_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "entries", lambda group: {})
    save(tmp_path / "out.json", ONE)
    with pytest.raises(RvadsError, match=r"entry point report of rvads\.pages: install all of pytest-rvads again"):
        save(tmp_path / "out.html", ONE)
