"""What ``rvads town`` leaves behind: replays, the page, the report, and the summary on standard output."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli.common import say, show
from pytest_rvads.report.session_report import NOTHING_JUDGED, UNFINISHED

if TYPE_CHECKING:
    from pytest_rvads.campaigns.resultsfile import Results
    from pytest_rvads.campaigns.town import Town
    from pytest_rvads.campaigns.town_tally import JunctionTally
    from pytest_rvads.simulators.simulator import Simulator

__all__ = ["Order", "written"]


@dataclass(frozen=True, slots=True)
class Order:
    """What was asked for, understood."""

    town: Town
    simulator: Simulator
    again: str
    """The command that runs some of it again; ids follow."""
    reports: tuple[Path, ...] = ()
    """Files to write reports to, beside that in the folder of the town."""


def written(order: Order, results: Results, folder: Path, executor: Executor | int | None, cut: str = "") -> int:
    """Write replays, page and report, print the summary, and return the exit status.

    Args:
        order: what was asked for.
        results: all there are.
        folder: to write to.
        executor: to simulate examples on.
        cut: why results are missing, or nothing.
    """
    from pytest_rvads.campaigns.replays import Replays, draw_replays
    from pytest_rvads.campaigns.town import tallied, town_records
    from pytest_rvads.campaigns.town_page import town_page
    from pytest_rvads.cli.progress_bar import progressing
    from pytest_rvads.report.files import save
    from pytest_rvads.storage import write_file

    town = order.town
    judged = town.judged(results)
    tallies, replays = tallied(judged), Replays()
    if not cut:
        with progressing("replays") as progress:
            replays = draw_replays(town, tallies, folder, order.again, executor, order.simulator, progress)
    missing = sum(town.counts.values()) - sum(tally.runs for tally in tallies.values())
    notes = (
        [f"INCOMPLETE: {cut or 'results are missing'}, {missing} runs have no result: run it again to go on"] if missing else []
    )
    notes += [*town.notes(), *replays.notes]
    status = _status(tallies, missing, flaky=bool(replays.flaky))
    report = replace(
        results.report(again=order.again),
        records=town_records(judged, {key: f"{folder / page}" for key, page in replays.looks.items()}, replays.flaky),
        notes=tuple(notes),
        exitstatus=status,
        complete=not missing,
        extents=town.plan.extents(),
        refused=town.refused(),
        drawn=town.drawn(),
        unfit={place.name: found.scenarios for place in town.plan.places if (found := town.plan.left_out(place))},
    )
    title = f"rvads town: {', '.join(map.stem for map in town.maps)}"
    told = [*notes, *(f"{one.taken:,} of {one.total:,} {one.what} drawn, seed {one.seed}" for one in report.drawn)]
    page = town_page(title, told, town.pictures(), town.sites(), tallies, replays.looks, order.again)
    write_file(folder / "town.html", page.encode())
    for path in (folder / "town.json", *order.reports):
        save(path, report)
    show(report)
    for note in notes:
        say(note)
    say(f"look: {folder / 'town.html'}")
    return status


def _status(tallies: Mapping[str, JunctionTally], missing: int, *, flaky: bool) -> int:
    """Return the exit status, as of a session."""
    found = {outcome for tally in tallies.values() for outcome in tally.outcomes}
    if missing:
        return UNFINISHED
    if flaky or any(outcome.bad for outcome in found):
        return 1
    return 0 if any(outcome.judges for outcome in found) else NOTHING_JUDGED
