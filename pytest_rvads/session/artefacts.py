"""The pictures and replay pages of failures."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.storage import slug, write_file
from pytest_rvads.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.runs.run import Run

__all__ = ["look", "prepare_folder", "show"]

_MOST = 100
"""A session that breaks everywhere needs no more pages than this from one process."""

_WRITTEN = pytest.StashKey[int]()


def look(item: pytest.Item, folder: str, run: Run, verdict: Verdict, rule: str | Rule, notes: str) -> tuple[str, str]:
    """Write the replay page and the picture of a failure.

    What can't be written is said in its place: a picture never costs a verdict.

    Args:
        item: whose it is.
        folder: where to write.
        run: what to show.
        verdict: what went wrong.
        rule: that was broken, to show its monitors.
        notes: what the page says beside the picture.

    Returns:
        The page with the time of the violation, or why there is none; and the picture as SVG, empty if there is none.
    """
    written = item.config.stash.get(_WRITTEN, 0)
    if written >= _MOST:
        return f"not drawn: {_MOST} failures of this process are drawn already", ""
    from pytest_rvads.failure_page import moment

    path = Path(folder) / f"{slug(item.nodeid)}.html"
    try:
        image = _write(item.config.invocation_params.dir / path, run, verdict, rule, notes)
    except Exception as error:
        return f"not drawn: {type(error).__name__}: {one_line(str(error))}", ""
    item.config.stash[_WRITTEN] = written + 1
    return f"{path.as_posix()}#t={moment(run, verdict):.2f}", image


def show(item: pytest.Item, report: pytest.TestReport, image: str) -> None:
    """Attach a picture (SVG) to the report of an item for pytest-html, where that is installed.

    It is encoded, because the self-contained mode of pytest-html takes pictures in no other form.
    """
    if item.config.pluginmanager.hasplugin("html"):
        content = b64encode(image.encode()).decode()
        extra = {"name": "scene", "format_type": "image", "content": content, "mime_type": "image/svg+xml", "extension": "svg"}
        report.extras = [*getattr(report, "extras", []), extra]  # type: ignore[attr-defined]


def prepare_folder(folder: Path) -> None:
    """Make the folder of artefacts, which version control ignores.

    Raises:
        OSError: it can't be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ignored = folder / ".gitignore"
    if not ignored.exists():
        ignored.write_text("*\n", encoding="utf-8")


def _write(target: Path, run: Run, verdict: Verdict, rule: str | Rule, notes: str) -> str:
    from pytest_rvads.failure_page import failure_pages, failure_picture

    prepare_folder(target.parent)
    page = next(failure_pages(run, verdict, rule, notes))
    write_file(target, page.html.encode())
    image = failure_picture(run, verdict)
    write_file(target.with_suffix(".svg"), image.encode())
    return image
