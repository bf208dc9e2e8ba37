"""The totals of ``rvads check``: numbers of verdicts, and an exit status."""

from __future__ import annotations

from pytest_rvads.cli.common import warn
from pytest_rvads.cli.run_answers import RunAnswer
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.outcome import Outcome
from pytest_rvads.report.at_junctions import AtJunctions
from pytest_rvads.report.rollup import sums
from pytest_rvads.report.session_report import NOTHING_JUDGED, exit_status
from pytest_rvads.wording import plural

__all__ = ["Totals"]

_MOST_DOUBTS = 20


class Totals:
    """Counts the answers on all runs."""

    def __init__(self) -> None:
        self._at = AtJunctions({})
        self._statuses: set[Status] = set()
        self.troubles: list[str] = []
        """A sentence per file or run that could not be read or judged."""
        self.runs = self.vehicles = self.files = self._doubts = 0

    def trouble(self, sentence: str) -> None:
        """Count and print a file or run that could not be read or judged."""
        self.troubles.append(sentence)
        warn(f"rvads: {sentence}")

    def doubt(self, sentence: str, *, every: bool) -> None:
        """Print a doubt about a run; only the first few doubts are printed, unless `every` doubt is wanted."""
        self._doubts += 1
        if every or self._doubts <= _MOST_DOUBTS:
            warn(f"warning: {sentence}")
        elif self._doubts == _MOST_DOUBTS + 1:
            warn("warning: further warnings are not printed, --verbose prints them")

    def add(self, answer: RunAnswer) -> None:
        """Count the answer on a run."""
        self.runs += 1
        self.vehicles += answer.vehicles
        self._statuses.update(verdict.status for verdict in answer.verdicts)
        for record in answer.records:
            self._at.add(record)

    def lines(self) -> list[str]:
        """Return the numbers of verdicts by rule as a table, and how much was judged."""
        _, rules, _ = sums(self._at.found)
        kinds = [kind.value for kind in rules.kinds if kind]
        table = [("", *kinds), *((row.name, *(str(count or "") for count in row.counts)) for row in rules.rows)]
        name = max((len(row.name) for row in rules.rows), default=0)
        lines = [f"{cells[0]:{name}}" + "".join(map(_right, cells[1:], kinds)) for cells in table] if rules.rows else []
        return [*map(str.rstrip, lines), self._judged]

    @property
    def _judged(self) -> str:
        told = f"{plural(self.runs, 'run')}, {plural(self.vehicles, 'vehicle')} judged"
        return f"{told}; {plural(len(self.troubles), 'thing')} could not be read or judged" if self.troubles else told

    @property
    def status(self) -> int:
        """The exit status."""
        # A rule that is violated is violated, whether or not somebody could have kept it.
        return exit_status({Outcome(status.value) for status in self._statuses}, whole=not self.troubles)

    def exit_status(self, *, told: bool) -> int:
        """Return the exit status; if a program reads the verdicts (`told`), the statuses 1 and 5 are not used."""
        if told and not self.troubles:
            return 0
        if self.status == NOTHING_JUDGED:
            unsure = "every verdict that applies is UNSURE"
            why = unsure if Status.UNSURE in self._statuses else "no rule applies to any of these runs"
            warn(f"rvads: nothing was judged: {why}")
        return self.status


def _right(text: str, kind: str) -> str:
    return f"{text:>{max(8, len(kind) + 2)}}"
