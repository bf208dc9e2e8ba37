"""The tables of a league, from its JSON object, and its page: drivers by rules, figures, and causes of failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.report.outline import FAILURES, Block, Notes, Section
from pytest_rvads.report.page import rendered
from pytest_rvads.satellites.campaigns.town_tally import cell
from pytest_rvads.search.trials import Fault
from pytest_rvads.support.wording import plural

__all__ = ["league_page", "sections", "summary"]

_MARKS = {"good": "good", "bad": "bad", "error": "bad"}
"""Marks of cells in sections, by the mark of a cell of a tally."""
_FAULTS = (Fault.IRRATIONAL, Fault.BOLD, Fault.TIMID, Fault.MANNERS)
_FIGURES = ("driver", "runs", "simulated", "pairs of movements met", "untested gap", "critical starts", *_FAULTS)
_CAUSES = ("verdicts", "rules", "cause", "replay", "first again")


def summary(driver: Mapping[str, Any]) -> str:
    """Return the results of a driver, a JSON object, in a line."""
    counts = sum((_counts(driver, rule) for rule in driver["verdicts"]), Counter[Tallied]())
    faults = Counter(side["fault"] for side in driver["sides"] if side["fault"])
    parts = [f"{driver['name']}: {plural(driver['runs'], 'run')}, {counted(counts) or 'no verdict'}"]
    parts += [f"{count} {fault} at critical starts" for fault, count in faults.items()]
    return "; ".join([*parts, *driver["notes"]])


def sections(league: Mapping[str, Any]) -> Iterator[Section]:
    """Yield the tables of a league, given its JSON object; the tables of causes of drivers without failures are left out."""
    verdicts = (((d["name"], ""), *(_verdict_cell(d, rule) for rule in league["rules"])) for d in league["drivers"])
    yield Section("verdicts", (), ("driver", *league["rules"]), tuple(verdicts))
    yield Section("figures", (), _FIGURES, tuple(_plain(_figures(driver)) for driver in league["drivers"]))
    for driver in league["drivers"]:
        if causes := tuple(_cause_rows(driver)):
            yield Section(f"causes: {driver['name']}", (), _CAUSES, causes)


def _counts(driver: Mapping[str, Any], rule: str) -> Counter[Any]:
    """Return the numbers of verdicts of a rule by outcome."""
    return Counter({Outcome(outcome): count for outcome, count in driver["verdicts"].get(rule, {}).items()})


def _verdict_cell(driver: Mapping[str, Any], rule: str) -> tuple[str, str]:
    """Return the worst outcome of a rule, and the number of runs to which the rule applied."""
    counts = _counts(driver, rule)
    del counts[Outcome.NA]
    text, mark = cell(counts)
    return f"{text} ({counts.total()})" if text and "/" not in text else text, _MARKS.get(mark, "")


def _figures(driver: Mapping[str, Any]) -> tuple[object, ...]:
    faults = Counter(side["fault"] for side in driver["sides"])
    met, hours, gap = f"{driver['met']} of {driver['pairs']}", f"{driver['hours']:.2f} h", f"{driver['gap']:g} s"
    started = sum(side["started"] for side in driver["sides"])
    return driver["name"], driver["runs"], hours, met, gap, started, *(faults[fault] for fault in _FAULTS)


def _cause_rows(driver: Mapping[str, Any]) -> Iterator[tuple[tuple[str, str], ...]]:
    for cause in driver["causes"]:
        text = cause["text"] if cause["title"] == FAILURES else f"{cause['title']}: {cause['text']}"
        *cells, command = _plain((cause["count"], ", ".join(cause["rules"]), text, cause["rerun"]))
        yield *cells, (cause["look"], "look"), command
    for side in driver["sides"]:
        if side["fault"] or side["error"]:
            text_of_side = side["error"] or f"{side['fault']} at a critical start where it {side['order']}"
            yield _plain((1, side["rule"], text_of_side, "", side["rerun"] or side["line"]))


def _plain(texts: Iterable[object]) -> tuple[tuple[str, str], ...]:
    """Return cells without a mark."""
    return tuple((str(text), "") for text in texts)


def league_page(league: Mapping[str, Any], title: str) -> str:
    """Return the HTML page of a league, given its JSON object."""
    drawn = f"{plural(league['cells'], 'cell')} and {plural(league['lines'], 'line')} of starts for every driver"
    setup = f"{drawn}, at {', '.join(league['junctions'])}, among {' and '.join(league['config']['traffic'])} traffic"
    notes = tuple(f"{driver['name']}: {note}" for driver in league["drivers"] for note in driver["notes"])
    blocks: list[Block | Section] = [Notes(notes), Section("cells", (setup,)), *sections(league)]
    return rendered(title, blocks, {})
