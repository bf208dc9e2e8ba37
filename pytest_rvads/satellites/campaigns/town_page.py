"""The page of a town: its map with the junctions in the colours of their verdicts, and the results of each junction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import quote

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.outline import Block
from pytest_rvads.report.page import rendered
from pytest_rvads.satellites.campaigns.town_picture import Spot, TownPicture
from pytest_rvads.satellites.campaigns.town_tally import JunctionTally, TownMark, cell
from pytest_rvads.support.wording import markup, quoted

__all__ = ["Site", "TownMap", "state", "town_page", "worst_first"]

LEGEND: tuple[tuple[TownMark, str], ...] = (
    ("bad", "failed"),
    ("error", "no verdict (ERROR)"),
    ("doubt", "open, provoked, unavoidable, unsure or incomplete"),
    ("good", "passed"),
    ("none", "refused or not judged"),
)
"""The marks on the map and their meanings, the worst first."""


@dataclass(frozen=True, slots=True)
class TownMap:
    """A map of a town."""

    name: str
    picture: TownPicture


@dataclass(frozen=True, slots=True)
class Site:
    """A junction of a town, with its properties on the page."""

    name: str
    """Name of the junction in ids."""
    id: str
    """Id of the junction in its map."""
    map: int
    """Number of its map among the maps of the page."""
    spot: Spot | None
    """Place of the junction on the map; None for a junction without lanes."""
    kind: str
    """Kind of the junction, such as ``4-way stop``."""
    planned: int = 0
    """Number of planned runs."""
    refused: str = ""
    """The reason why nothing runs at the junction."""
    notes: tuple[str, ...] = ()
    """Further sentences, for example on scenarios that were left out."""


def state(site: Site, tally: JunctionTally) -> TownMark:
    """Return the mark of a junction; a junction with missing runs is not good yet."""
    return "doubt" if tally.mark == "good" and tally.runs < site.planned else tally.mark


def worst_first(sites: Sequence[Site], tallies: Mapping[str, JunctionTally]) -> list[Site]:
    """Return the junctions, the worst first; equally bad junctions in the given order."""

    def wrong(site: Site) -> tuple[int, ...]:
        tally = tallies.get(site.name, JunctionTally())
        marks = [mark for mark, _ in LEGEND]
        found = tally.outcomes
        return marks.index(state(site, tally)), *(
            -found[outcome] for outcome in Outcome.worst_first() if outcome.mark in ("bad", "doubt")
        )

    return sorted(sites, key=wrong)


def town_page(  # noqa: PLR0913 - the content of the page
    title: str,
    blocks: Sequence[Block],
    maps: Sequence[TownMap],
    sites: Sequence[Site],
    tallies: Mapping[str, JunctionTally],
    looks: Mapping[tuple[str, str], str],
    again: str,
) -> str:
    """Return the page.

    Args:
        title: the title of the page.
        blocks: the blocks of the report that the page begins with, and its figures.
        maps: one or more maps.
        sites: all junctions of the maps, also junctions where nothing runs.
        tallies: the results of the junctions with runs, by name.
        looks: by name of a run and rule, the path of the replay relative to the folder of the page.
        again: the command that runs a part of the town again, to be followed by ids of runs.
    """
    ordered = worst_first(sites, tallies)
    found = [_shown(site, tallies.get(site.name, JunctionTally()), looks, again) for site in ordered]
    marks = Counter(str(one["state"]) for one in found)
    said = "; ".join(f"{marks[mark]} {what}" for mark, what in LEGEND if marks[mark])
    content = {
        "maps": [{"name": one.name, "view": one.picture.view, "lanes": one.picture.lanes} for one in maps],
        "junctions": found,
        "legend": LEGEND,
    }
    marked = markup(f"{len(found)} junctions: {said}" if found else "no junctions")
    return rendered(title, blocks, content, ("pytest_rvads.satellites.campaigns", "town_page"), marked=marked)


def _shown(site: Site, tally: JunctionTally, looks: Mapping[tuple[str, str], str], again: str) -> dict[str, object]:
    """Return the content of the page on a junction, for JSON."""
    configurations = sorted({cfg for _, cfg, _ in tally.table})
    rules = list(dict.fromkeys(rule for rule, _, _ in sorted(tally.table)))
    outcomes = {(rule, cfg): Counter[Outcome]() for rule in rules for cfg in configurations}
    for (rule, cfg, outcome), count in tally.table.items():
        outcomes[rule, cfg][outcome] = count
    missing = site.planned - tally.runs
    notes = [f"refused: {site.refused}"] if site.refused else []
    notes += [f"{missing} of {site.planned} runs are missing"] if missing > 0 else []
    notes += [f"{count} of {tally.runs} runs were simulated at {name}, of the same shape" for name, count in tally.shapes.items()]
    notes += [f"{tally.untold} more verdicts have causes of their own"] if tally.untold else []
    causes = [
        (
            title,
            [
                {
                    "count": cause.count,
                    "rule": ", ".join(cause.rules[:3]) + (f" and {len(cause.rules) - 3} more" if len(cause.rules) > 3 else ""),
                    "text": cause.text,
                    "look": quote(looks.get((cause.run, cause.rule), ""), safe="/#=."),
                    "again": f"{again} {quoted(f'{cause.run}-{cause.rule}')}",
                }
                for cause in group
            ],
        )
        for title, group in tally.grouped()
    ]
    return {
        "name": site.name,
        "id": site.id,
        "map": site.map,
        "spot": site.spot,
        "kind": site.kind,
        "state": state(site, tally),
        "told": tally.told or ("refused" if site.refused else "nothing judged"),
        "notes": [*notes, *site.notes],
        "configurations": configurations,
        "rules": [(rule, [cell(outcomes[rule, cfg]) for cfg in configurations]) for rule in rules],
        "causes": causes,
        "again": f"{again} {quoted(f'{site.name}-*')}" if tally.runs else "",
    }
