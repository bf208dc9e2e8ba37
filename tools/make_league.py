"""Write the tables of docs/league.md from docs/league.json: ``python tools/make_league.py``.

``python tools/make_league.py FILE`` takes the results from the JSON file of a league first. ``--pictures FOLDER`` draws the
findings anew, with CARLA's package ``agents`` in a folder.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pytest_rvads.report.files import section
from pytest_rvads.report.outline import Section

ROOT = Path(__file__).parents[1]
PAGE, RESULTS, PICTURES = (ROOT / "docs" / name for name in ("league.md", "league.json", "league"))
MARK = "<!-- tables: python tools/make_league.py -->"


def main() -> None:
    """Write the page, and what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", nargs="?", type=Path, help="JSON file of a league")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw the findings with CARLA's agents in this folder")
    options = parser.parse_args()
    if options.results:
        RESULTS.write_text(options.results.read_text(encoding="utf-8"), encoding="utf-8")
    if options.pictures:
        for name, svg in pictures(options.pictures):
            (PICTURES / name).write_text(svg, encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the page: the text before the tables as it is, then the tables."""
    league = json.loads(RESULTS.read_text(encoding="utf-8"))
    lines = [PAGE.read_text(encoding="utf-8").partition(MARK)[0] + MARK]
    for part in (Section(**fields) for fields in league["sections"] if not fields["side"]):
        kept = [number for number, column in enumerate(part.columns) if column != "replay"]  # replays are no part of the page
        columns, rows = tuple(part.columns[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in part.rows)
        lines += ["", *section(replace(part, title=part.title[0].upper() + part.title[1:], columns=columns, rows=rows))]
    return "\n".join(lines) + "\n"


def pictures(carla: Path) -> Iterator[tuple[str, str]]:
    """Yield the name and the text of a picture per finding and state of CARLA's code, before and after the change."""
    sys.path.insert(0, str(ROOT))
    from tests.clients.carla_copy import carla_copy
    from tests.clients.findings import FINDINGS, imported, pictured

    with tempfile.TemporaryDirectory() as folder:
        for id, finding in FINDINGS.items():
            for after in (False, True) if finding.after else (False,):
                name = f"{id}-{'after' if after else 'before'}.svg"
                copy = carla_copy(carla, Path(folder) / name, *(finding.after if after else finding.before))
                yield name, pictured(finding, imported(copy), after)[1]


if __name__ == "__main__":
    main()
