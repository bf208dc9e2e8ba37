"""The page of a town: its map with the junctions in the colours of their verdicts, and the results of each junction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from urllib.parse import quote

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.outline import Block
from pytest_rvads.report.page import rendered
from pytest_rvads.satellites.campaigns.town_picture import Site, TownMap
from pytest_rvads.satellites.campaigns.town_tally import Tally, TownMark, cell
from pytest_rvads.support.wording import markup, plural, quoted

__all__ = ["state", "town_page", "worst_first"]

LEGEND: tuple[tuple[TownMark, str], ...] = (
    ("bad", "failed"),
    ("error", "no verdict (ERROR)"),
    ("doubt", "open, provoked, unavoidable, unsure or incomplete"),
    ("good", "passed"),
    ("none", "refused or not judged"),
)
"""The marks (colours) of junctions on the map, with their meanings, from the worst to the best."""


def state(site: Site, tally: Tally) -> TownMark:
    """Return the mark (colour) of a junction on the map; a junction of which results are missing is never ``good``."""
    return "doubt" if tally.mark == "good" and tally.runs < site.planned else tally.mark


def worst_first(sites: Sequence[Site], tallies: Mapping[str, Tally]) -> list[Site]:
    """Return the junctions sorted by their marks and numbers of failures, the worst first; ties keep the given order."""

    def wrong(site: Site) -> tuple[int, ...]:
        tally = tallies.get(site.name, Tally())
        marks = [mark for mark, _ in LEGEND]
        outcomes = tally.outcomes
        return marks.index(state(site, tally)), *(
            -outcomes[outcome] for outcome in Outcome.worst_first() if outcome.mark in ("bad", "doubt")
        )

    return sorted(sites, key=wrong)


def town_page(  # noqa: PLR0913 - the content of the page
    title: str,
    blocks: Sequence[Block],
    maps: Sequence[TownMap],
    sites: Sequence[Site],
    tallies: Mapping[str, Tally],
    looks: Mapping[tuple[str, str], str],
    again: str,
) -> str:
    """Return the HTML page of a town.

    Args:
        title: the title of the page.
        blocks: the blocks (parts of a report, see `outline`) that the page shows above the map.
        maps: one or more maps.
        sites: the requested junctions of the maps, including junctions without runs.
        tallies: the results of the junctions with runs, by name.
        looks: by name of a run and rule, the path of the replay relative to the folder of the page.
        again: the beginning of a command that runs a part of the town again; the page appends ids of runs.
    """
    ordered = worst_first(sites, tallies)
    junctions = [_junction_data(site, tallies.get(site.name, Tally()), looks, again) for site in ordered]
    marks = Counter(str(entry["state"]) for entry in junctions)
    counts_text = "; ".join(f"{marks[mark]} {what}" for mark, what in LEGEND if marks[mark])
    content = {
        "maps": [{"name": entry.name, "view": entry.picture.view, "lanes": entry.picture.lanes} for entry in maps],
        "junctions": junctions,
        "legend": LEGEND,
    }
    heading_text = markup(f"{plural(len(junctions), 'junction')}: {counts_text}" if junctions else "no junctions")
    return rendered(title, blocks, content, ("pytest_rvads.satellites.campaigns", "town_page"), marked=heading_text)


def _junction_data(site: Site, tally: Tally, looks: Mapping[tuple[str, str], str], again: str) -> dict[str, object]:
    """Return what the page shows of a junction, as a JSON object for the script of the page."""
    configurations = sorted({cfg for _, cfg, _ in tally.table})
    rules = list(dict.fromkeys(rule for rule, _, _ in sorted(tally.table)))
    outcomes = {(rule, cfg): Counter[Outcome]() for rule in rules for cfg in configurations}
    for (rule, cfg, outcome), count in tally.table.items():
        outcomes[rule, cfg][outcome] = count
    missing = site.planned - tally.runs
    notes = [f"refused: {site.refused}"] if site.refused else []
    notes += [f"{missing} of {site.planned} runs are missing"] if missing > 0 else []
    notes += [f"{count} of {tally.runs} runs were simulated at {name}, of the same shape" for name, count in tally.shapes.items()]
    notes += [f"{tally.unlisted} more verdicts have causes of their own"] if tally.unlisted else []
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
        "told": tally.text or ("refused" if site.refused else "nothing judged"),
        "notes": [*notes, *site.notes],
        "configurations": configurations,
        "rules": [(rule, [cell(outcomes[rule, cfg]) for cfg in configurations]) for rule in rules],
        "causes": causes,
        "again": f"{again} {quoted(f'{site.name}-*')}" if tally.runs else "",
    }
