"""The command ``rvads docs``, which shows the pages of the documentation that ships with the package; no network is needed."""

from __future__ import annotations

import argparse
from pathlib import Path
from pydoc import pager

import pytest_rvads
from pytest_rvads.cli.common import Subparsers, say
from pytest_rvads.support.errors import RvadsError

_START = "README"
"""The name of the page that leads to all other pages; the list of pages begins with it."""


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads docs`` to the parser."""
    docs = commands.add_parser(
        "docs",
        help="show a page of the documentation; without a page list all pages",
        description="Shows a page of the documentation in the terminal, as Markdown. The pages ship with the package.",
    )
    docs.add_argument("page", metavar="PAGE", nargs="?", help="name of the page, such as tutorial (default: list all pages)")
    docs.set_defaults(command=_docs)


def pages() -> dict[str, Path]:
    """Return the files of all pages by name; a page in a subfolder of the documentation is named ``folder/page``."""
    package = Path(pytest_rvads.__file__).parent
    for folder in (package / "docs", package.parent / "docs"):  # of an installed package, and of a checkout
        if found := {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.md"))}:
            return {_START: found.pop(_START), **found}
    raise RvadsError(
        f"the pages of the documentation are not in {package / 'docs'}, where the package has them: install it again"
    )


def _docs(options: argparse.Namespace) -> int:
    files = pages()
    if options.page is None:
        width = max(map(len, files))
        for name, path in files.items():
            say(f"{name:<{width}}  {path.read_text(encoding='utf-8').partition(chr(10))[0].removeprefix('# ')}")
        say("next: rvads docs PAGE")
        return 0
    page = options.page.removesuffix(".md")
    if page not in files:
        raise RvadsError(f"the documentation has no page {options.page!r}: rvads docs lists all pages")
    pager(files[page].read_text(encoding="utf-8"))
    return 0
