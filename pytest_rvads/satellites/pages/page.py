"""Makes the self-contained HTML page of a report. The page shows session, causes and failures, and folds all other parts."""

from __future__ import annotations

import json
import os
import re
from base64 import b64encode
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from hashlib import sha256
from heapq import nsmallest
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from pytest_rvads.logic.outcome import MARKS, Outcome
from pytest_rvads.report.folders import STARTS, option, sessions
from pytest_rvads.report.matrix import SAME, Matrix, member_of, place_of
from pytest_rvads.report.outline import FAILURES, LONG, Block, Causes, RollUp, outline
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.session_report import LISTED, Report
from pytest_rvads.support.wording import printable, quoted

_PLACE = "pytest_rvads.satellites.pages"
_TEMPLATES = Environment(
    loader=PackageLoader(_PLACE, ""),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    finalize=lambda value: printable(value, len(value)) if type(value) is str else value,
)
_ITEMS = 5000
"""Largest number of test items on a page: failures are taken first, then further items evenly from all junctions and rules."""
_WEB = re.compile(r"https://[^\\\s]+")
_NO_PATH = re.compile(r"[^/?#]*:| *//|.*[\\\t\n]", re.DOTALL)
"""Matches an address with a scheme or with another host, and texts that browsers would turn into such an address."""
_UNDRAWN = "not drawn"
"""The beginning of the text that takes the place of a missing replay page; the reason follows."""


def page(report: Report, folder: Path, title: str = "rvads verdicts", pictures: Sequence[Block] = ()) -> str:
    """Return a report as an HTML page, with pictures before its causes."""
    blocks = outline(report, tables=True)
    records = _page_records(report)
    statuses = {record.status for record in records}
    rolled = ""
    sums: list[dict[str, Any]] = []
    groups: list[dict[str, Any]] = []
    matrices: list[dict[str, Any]] = []
    for block in blocks:
        if isinstance(block, RollUp):
            rolled += block.title
            for table in block.sums:
                kinds = ["" if kind is None else kind.mark for kind in table.kinds]
                marks = [""] * (1 + len(table.headings)) + kinds
                rows = [table.cells(row) for row in table.rows]
                columns = {"corner": table.corner, "columns": table.columns, "sides": table.sides}
                sums.append({**columns, "marks": marks, "rows": rows})
        elif isinstance(block, Causes):
            causes = [
                {"count": c.count, "rule": c.rule, "text": c.line, "ids": c.nodeids, "first": c.example, "again": block.first(c)}
                for c in block.causes
            ]
            groups.append({"title": block.title, "failed": block.title == FAILURES, "causes": causes})
        elif isinstance(block, Matrix):
            labelled = [
                (label, [(entry.text, entry.bad) for entry in entries], members)
                for (label, entries), members in zip(block.rows, block.members, strict=True)
            ]
            names = {"title": block.title, "junction": block.junction, "corner": block.corner, "columns": block.columns}
            matrices.append({**names, "numbers": block.numbers, "rows": labelled})
    session, place = "", Path(os.path.realpath(folder))  # a link such as `latest` can lead to another session later
    if place in sessions(place.parent):
        with suppress(ValueError):  # no relative path leads to another drive
            place = Path(os.path.relpath(place))
        session = option(place)
    content = {
        "items": [_item_data(record, folder, report, session) for record in records],
        "all": len(report.records),
        "sums": sums,
        "rolled": rolled,
        "causes": groups,
        "matrices": matrices,
        "statuses": {outcome: outcome.mark for outcome in Outcome.worst_first() if outcome in statuses},
    }
    starts = next((path for path in (folder / STARTS, folder.parent / STARTS) if path.is_file()), None)
    link = os.path.relpath(starts, folder).replace(os.sep, "/") if starts else ""
    return rendered(title, [*blocks, *pictures], content, folder, "items.js", "picture.js", with_items=True, starts=link)


def rendered(
    title: str,
    blocks: Sequence[Block],
    data: object,
    folder: Path,
    *sources: str,
    with_items: bool = False,
    starts: str = "",
) -> str:
    """Return an HTML page for a folder: head, sections, pictures and figures of an outline; scripts show `data`."""
    kinds = [(type(block).__name__, block) for block in blocks]
    link = partial(_page_link, folder=folder)
    flags: dict[str, Any] = {"same": SAME, "long": LONG, "with_items": with_items, "starts": starts}
    return webpage("page.html", title, data, ("page.css", *sources), blocks=kinds, link=link, **flags)


def _page_records(report: Report) -> list[Record]:
    """Return the records of the items that the page shows, in the order of the report."""
    if len(report.records) <= _ITEMS:
        return list(report.records)
    counts: Counter[tuple[int, str, str]] = Counter()

    def ranked() -> Iterator[tuple[int, int, int, Record]]:
        for number, record in enumerate(report.records):
            wrong = record.failed or (record.status.bad and not record.known)
            key = 0 if wrong else 1 if record.known or record.status.mark == "doubt" else 2, record.junction, record.asks
            counts[key] += 1
            yield key[0], counts[key], number, record

    numbered_records = nsmallest(_ITEMS, ranked(), key=lambda row: row[:3])
    return [record for *_, record in sorted(numbered_records, key=lambda row: row[2])]


def _item_data(record: Record, folder: Path, report: Report, session: str) -> dict[str, Any]:
    group, _, (cfg, rule) = place_of(record)
    driver, simulator = (record.driver, record.simulator) if isinstance(record, SimulatedItem) else ("", "")
    looks = (record.look, *record.looks)
    links = [link for link in (_page_link(look, folder) for look in looks) if link]
    drawn = record.look and not record.look.startswith(_UNDRAWN)
    kept = record.hash and (record.shows if record.failed else report.kept)
    draw = ""
    if kept and not drawn and report.again.startswith("pytest"):
        draw = " ".join(filter(None, ("rvads replay", session, quoted(record.nodeid))))
    return {
        "id": record.nodeid,
        "group": group,
        "junction": record.junction,
        "kind": record.kind,
        "status": record.status,
        "failed": record.failed,
        "known": bool(record.known),
        "change": record.change if record.change in LISTED else "",
        "member": member_of(record),
        "cfg": cfg,
        "rule": rule,
        "text": record.message,
        "driver": driver,
        "simulator": simulator,
        "look": links[0] if links else "",
        "more": links[1:],
        "why": next((look for look in looks if look.startswith(_UNDRAWN)), ""),
        "draw": draw,
    }


def _page_link(look: str, folder: Path) -> str:
    """Return a link from a folder to a page; an empty text if the link would be neither a relative path nor https."""
    if look.startswith(_UNDRAWN):
        return ""
    look = printable(look, len(look))  # control characters become backslashes, which are refused
    if _WEB.fullmatch(look):
        return look
    if not look or _NO_PATH.match(look):
        return ""
    path = os.path.relpath(look, folder).replace(os.sep, "/")
    return "" if _NO_PATH.match(path) else path


def webpage(template: str, title: str, data: object, sources: Sequence[str], *, style: str = "", **content: Any) -> str:
    """Return an HTML page made of a template that extends ``frame.html``; style sheets and scripts are files of this package."""
    light, dark = ("".join(f"--{mark}:{look[number]};" for mark, look in MARKS.items()) for number in (1, 2))
    colours = f":root{{{light}}}@media screen{{:root[data-theme=dark]{{{dark}}}}}"
    texts = {name: files(_PLACE).joinpath(name).read_text(encoding="utf-8") for name in ("webpage.js", *sources)}
    style = colours + "".join(texts[name] for name in sources if name.endswith(".css")) + style
    script = "".join(text for name, text in texts.items() if name.endswith(".js"))
    digests = [b64encode(sha256(text.encode()).digest()).decode() for text in (script, style)]
    policy = (
        f"default-src 'none'; script-src 'sha256-{digests[0]}'; style-src 'sha256-{digests[1]}'; img-src data:; "
        "base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
    )
    # "<" could end the script element from inside a string.
    text = json.dumps(_printable_data(data), separators=(",", ":")).replace("<", "\\u003c")
    frame = {"policy": policy, "style": Markup(style), "script": Markup(script), "data": Markup(text)}
    return _TEMPLATES.get_template(template).render(title=title, **frame, **content)


def _printable_data(value: Any) -> Any:
    """Return a JSON value with the control characters in its texts escaped."""
    if isinstance(value, str):
        return printable(value, len(value))
    if isinstance(value, dict):
        return {key: _printable_data(inner) for key, inner in value.items()}
    return list(map(_printable_data, value)) if isinstance(value, list | tuple) else value
