"""The pictures and replay pages of failures."""

from __future__ import annotations

import re
from base64 import b64encode
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.errors import FormulaError
from pytest_rvads.storage import write_file
from pytest_rvads.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.draw.replay import Track
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.runs.run import Run

__all__ = ["look", "prepare_folder", "show", "slug"]

_MOST = 100
"""A session that breaks everywhere needs no more pages than this from one process."""

_LONGEST = 190
"""Longest name of a file without its ending [bytes]; file systems take 255."""
_PLAIN = re.compile(r"(?:\w+/)*\w+\.py(?:::\w+)*(?:\[[\w.-]*[\w.]\])?", re.ASCII)
"""Ids of items that can still be told apart when brackets and slashes have become hyphens."""
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
    time = run.duration if verdict.time is None else verdict.time
    path = Path(folder) / f"{slug(item.nodeid)}.html"
    try:
        image = _write(item.config.invocation_params.dir / path, run, verdict, time, rule, notes)
    except Exception as error:
        return f"not drawn: {type(error).__name__}: {one_line(str(error))}", ""
    item.config.stash[_WRITTEN] = written + 1
    return f"{path.as_posix()}#t={time:.2f}", image


def show(item: pytest.Item, report: pytest.TestReport, image: str) -> None:
    """Attach a picture (SVG) to the report of an item for pytest-html, where that is installed.

    It is encoded, because the self-contained mode of pytest-html takes pictures in no other form.
    """
    if item.config.pluginmanager.hasplugin("html"):
        content = b64encode(image.encode()).decode()
        extra = {"name": "scene", "format_type": "image", "content": content, "mime_type": "image/svg+xml", "extension": "svg"}
        report.extras = [*getattr(report, "extras", []), extra]  # type: ignore[attr-defined]


def slug(nodeid: str) -> str:
    """Return a file name for an item, without an ending, short enough for every file system; no two items share one."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", nodeid.replace(".py::", ".")).strip("-")
    if _PLAIN.fullmatch(nodeid) and len(name) <= _LONGEST:
        return name
    digest = sha256(nodeid.encode("utf-8", "surrogatepass")).hexdigest()[:12]
    return f"{name[: _LONGEST - 13]}-{digest}"


def prepare_folder(folder: Path) -> None:
    """Make the folder of artefacts, which version control ignores.

    Raises:
        OSError: it can't be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ignored = folder / ".gitignore"
    if not ignored.exists():
        ignored.write_text("*\n", encoding="utf-8")


def _write(target: Path, run: Run, verdict: Verdict, time: float, rule: str | Rule, notes: str) -> str:
    from pytest_rvads.draw.picture import picture
    from pytest_rvads.draw.replay import replay

    prepare_folder(target.parent)
    page = replay(run, verdict.message, notes, [(time, verdict.message)], _tracks(run, rule), verdict.responsible)
    write_file(target, page.encode())
    image = picture(run, round(time / run.dt), verdict.message, verdict.responsible)
    write_file(target.with_suffix(".svg"), image.encode())
    return image


def _tracks(run: Run, rule: str | Rule) -> list[Track]:
    """Return the monitors of a rule, without those to which nothing ever happened; none of a rule that is known by no name."""
    from pytest_rvads.draw.replay import Track
    from pytest_rvads.logic.timeline import timelines

    try:
        found = [line for line in timelines(run, rule) if line.moved]
    except FormulaError:
        return []
    vehicles = {agent.name for agent in run.agents}
    bound = [[value for _, value in line.binding if value in vehicles] for line in found]
    name = rule if isinstance(rule, str) else rule.name
    return [Track(f"{name} {', '.join(who)}", line.changes) for who, line in zip(bound, found, strict=True)]
