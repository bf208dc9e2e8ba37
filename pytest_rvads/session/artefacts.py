"""What a session leaves of its failures: the runs, and of the first ones pictures and replay pages.

The run of a failure is kept once, by its hash, and drawn on request: a session in which everything fails would draw for minutes.
``rvads replay`` needs the folder alone: the run, and the report for rule, messages and facts.
"""

from __future__ import annotations

from base64 import b64encode
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.errors import RvadsError
from pytest_rvads.session.folder import FOLDER
from pytest_rvads.storage import slug, write_file
from pytest_rvads.wording import one_line, quoted

if TYPE_CHECKING:
    from pytest_rvads.draw.replay import Beside
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.runs.run import Run

__all__ = ["Shown", "look", "show"]

_MOST = 20
"""A process draws the first failures, and the first of every rule; whoever wants to see another one asks `rvads replay`."""
_ROOM = 200 * 2**20
"""What the runs of a session may take on disk; one of four vehicles and 30 s takes a quarter of a megabyte [bytes]."""
_DRAWN: pytest.StashKey[Counter[str]] = pytest.StashKey()
"""Rule to how many of its failures this process has drawn."""


@dataclass(frozen=True, slots=True)
class Shown:
    """Where a failure can be looked at."""

    told: str
    """The page with the time of the violation, else the command that draws it, or why there is neither."""
    page: str = ""
    """The page again, empty if there is none."""
    image: str = ""
    """SVG text of the picture; empty if no picture was drawn."""


def look(item: pytest.Item, run: Run, verdict: Verdict, rule: str | Rule, notes: str, around: Callable[[], Beside]) -> Shown:
    """Keep the run of a failure, and write its replay page and picture where it is among the first.

    What can't be written is said in its place: a picture never costs a verdict.

    Args:
        item: whose it is.
        run: what to show.
        verdict: what went wrong.
        rule: that was broken, to show its monitors.
        notes: what the page says beside the picture.
        around: gives what else it says and shows; asked only for a page that is drawn.
    """
    from pytest_rvads.report.folders import option

    drawn = item.config.stash.setdefault(_DRAWN, Counter())
    session = item.config.stash[FOLDER]
    try:
        folder = session.made()
        unkept = _keep(folder, run)
    except Exception as error:
        return Shown(f"not drawn: {_said(error)}")
    if drawn.total() >= _MOST and drawn[verdict.rule]:
        which = option(Path(session.told(folder)))
        return Shown(f"not drawn, and {unkept}" if unkept else f"rvads replay {which} {quoted(item.nodeid)}")
    try:
        found = _draw(folder, item, run, verdict, rule, notes, around())
    except Exception as error:
        return Shown(f"not drawn: {_said(error)}")
    drawn[verdict.rule] += 1
    from pytest_rvads.failure_page import moment

    page, image = found
    told = f"{session.told(page)}#t={moment(run, verdict):.2f}"
    return Shown(told, told, image)


def show(item: pytest.Item, report: pytest.TestReport, image: str) -> None:
    """Attach a picture (SVG) to the report of an item for pytest-html, where that is installed.

    It is encoded, because the self-contained mode of pytest-html takes pictures in no other form.
    """
    if item.config.pluginmanager.hasplugin("html"):
        content = b64encode(image.encode()).decode()
        extra = {"name": "scene", "format_type": "image", "content": content, "mime_type": "image/svg+xml", "extension": "svg"}
        report.extras = [*getattr(report, "extras", []), extra]  # type: ignore[attr-defined]


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {one_line(str(error))}"


def _keep(folder: Path, run: Run) -> str:
    """Keep a run, unless another failure of it has; return why it is not, or nothing."""
    from pytest_rvads.report.folders import run_file, used
    from pytest_rvads.runs.runfile import save_run

    path = run_file(folder, run.hash)
    if path.exists():
        return ""
    if used(folder) >= _ROOM:
        return f"its run is not kept, those of this session take {_ROOM // 2**20} MB already: run it again alone"
    try:
        save_run(run, path)
    except RvadsError as error:  # a full disk, or a provenance that no file holds
        return f"its run is not kept: {one_line(str(error))}"
    return ""


def _draw(  # noqa: PLR0913 - a failure, and what is said of it
    folder: Path, item: pytest.Item, run: Run, verdict: Verdict, rule: str | Rule, notes: str, beside: Beside
) -> tuple[Path, str]:
    """Write page and picture, and return where the page is, and the picture."""
    from pytest_rvads.failure_page import failure_pages, failure_picture
    from pytest_rvads.report.folders import shown

    target = shown(folder, slug(item.nodeid))
    page = next(failure_pages(run, verdict, rule, notes, beside))
    write_file(target, page.html.encode())
    image = failure_picture(run, verdict)
    write_file(target.with_suffix(".svg"), image.encode())
    return target, image
