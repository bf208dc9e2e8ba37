"""Run the tests of docs/gallery.md and write a replay page for each: ``python tools/make_gallery.py FOLDER``.

Every section of the page holds one test that fails, the name of its replay in a comment, and lines that pytest prints of it. The
exit status is 1 where a test does not fail, or prints something else than the page says.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.report.failures import Beside
from pytest_rvads.satellites.pages.replay import failure_pages
from pytest_rvads.support.storage import write_file

PAGE = Path(__file__).parents[1] / "docs" / "gallery.md"


@dataclass(frozen=True, slots=True)
class Failure:
    """A section of the page."""

    name: str
    """Of its replay, and of its test file with hyphens for underscores."""
    code: str
    printed: tuple[str, ...]
    """Lines that pytest prints of it."""


def failures(page: str) -> list[Failure]:
    """Return what the sections of the page hold."""
    found = []
    for section in page.split("\n## ")[1:]:
        blocks = dict(re.findall(r"^```(python|text)\n(.*?)^```", section, re.MULTILINE | re.DOTALL))
        named = re.search(r"^<!-- replay: ([\w-]+) -->$", section, re.MULTILINE)
        if named:
            found.append(Failure(named[1], blocks["python"], tuple(blocks["text"].splitlines())))
    return found


@dataclass
class Watcher:
    """A plugin that keeps what failed: by test file its run, its rule and what was told of it."""

    seen: dict[str, tuple[Any, Any, str]] = field(default_factory=dict)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> Any:
        """Look at the report of a test when all others have added to it."""
        values: dict[str, Any] = getattr(item, "funcargs", {})
        report = yield
        if call.when == "call" and report.failed:
            told = "\n".join([report.longreprtext, *(text for title, text in report.sections if title.startswith("rvads "))])
            self.seen[item.path.stem] = values["run"], values["rule"], told
        return report


def make(page: str, folder: Path) -> list[str]:
    """Run the tests of a page, write their replays into a folder and return what is not as the page says."""
    watcher, wanted = Watcher(), failures(page)
    with tempfile.TemporaryDirectory() as place, chdir(place), open(os.devnull, "w", encoding="utf-8") as nothing:
        for failure in wanted:
            Path(f"{_file(failure)}.py").write_text(failure.code, encoding="utf-8")
        shutil.copy(PAGE.with_name("five.xodr"), ".")
        options = [
            "--tb=short",
            "--rvads-artefacts=none",
            "-p",
            "no:cacheprovider",
            "-c",
            "/dev/null",
            "--import-mode=importlib",
        ]
        with redirect_stdout(nothing):
            pytest.main([*options, "--rootdir=."], plugins=[watcher])
    for failure in wanted:
        sys.modules.pop(_file(failure), None)  # else another page's test of that name would be this one
    wrong = []
    for failure in wanted:
        if _file(failure) not in watcher.seen:
            wrong.append(f"{failure.name}: its test did not fail")
            continue
        run, rule, told = watcher.seen[_file(failure)]
        lines = [line.rstrip() for line in told.splitlines()]
        wrong += [f"{failure.name}: pytest does not print {line!r}" for line in failure.printed if line not in lines]
        notes = "\n".join(line for line in lines[_head(lines) :] if not line.startswith("look "))
        rerun = next(line.removeprefix("rerun").strip() for line in reversed(lines) if line.startswith("rerun "))
        first = next(failure_pages(run, rvads.check(run, rule), rule, notes, Beside((("rerun", rerun),))))
        write_file(folder / f"{failure.name}.html", first.html.encode())
    return wrong


def _file(failure: Failure) -> str:
    return f"test_{failure.name.replace('-', '_')}"


def _head(lines: list[str]) -> int:
    """Return where the explanation of a violation begins."""
    return next((k for k, line in enumerate(lines) if line.startswith("rule  ")), 0)


def main() -> int:
    """Write the replays into the folder named on the command line."""
    if len(sys.argv) != 2:
        print("usage: python tools/make_gallery.py FOLDER", file=sys.stderr)
        return 2
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    wrong = make(PAGE.read_text(encoding="utf-8"), folder.resolve())
    for line in wrong:
        print(line, file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
