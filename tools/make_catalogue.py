"""Write the tables of docs/what-a-green-means.md from the catalogue that the tests show: ``python tools/make_catalogue.py``."""

from __future__ import annotations

import importlib.util
import re
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "what-a-green-means.md"
SOURCE = ROOT / "tests" / "honesty" / "catalogue.py"
SECTIONS = {
    "CHEATS": ("What was tried to get a green that is not deserved", "attempt", "result"),
    "INNOCENTS": ("What must not be blamed", "a driver that", "result"),
    "UNWATCHED": ("What no rule looks at", "a driver that", "result"),
}


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the page: the text before the first table as it is, then the tables."""
    catalogue = _load()
    head, _, _ = PAGE.read_text(encoding="utf-8").partition(f"## {SECTIONS['CHEATS'][0]}")
    parts = [head.rstrip()]
    for name, (title, subject, told) in SECTIONS.items():
        entries = getattr(catalogue, name)
        parts.append(f"## {title}")
        for group, members in groupby(entries, key=lambda entry: entry.group):
            rows = "\n".join(f"| {_cell(entry.tries)} | {_cell(entry.told)} |" for entry in members)
            parts.append(f"### {group[0].upper()}{group[1:]}\n\n| {subject} | {told} |\n|---|---|\n{rows}")
    return "\n\n".join(parts) + "\n"


def _cell(text: str) -> str:
    return re.sub(r"([|])", r"\\\1", text)


def _load() -> Any:
    spec = importlib.util.spec_from_file_location("rvads_catalogue", SOURCE)
    assert spec
    assert spec.loader
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    main()
