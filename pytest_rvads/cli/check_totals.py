"""The totals of ``rvads check``: numbers of verdicts, and an exit status."""

from __future__ import annotations

from collections import Counter

from pytest_rvads.cli.common import warn
from pytest_rvads.cli.run_answers import Batch, RunAnswer
from pytest_rvads.logic.judging.verdicts import Status

__all__ = ["Labels", "Totals"]

_MOST_DOUBTS = 20


class Labels:
    """Unique labels of runs; a label that occurs again, in the same file or another, is extended."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def of(self, answer: RunAnswer) -> str:
        """Return the label of a run, different from all earlier labels."""
        label, number = answer.label, 1
        while label in self._known:
            label = f"{answer.file}: {answer.label}" + (f" ({number})" if number > 1 else "")
            number += 1
        self._known.add(label)
        return label


class Totals:
    """Counts the answers on all runs."""

    def __init__(self) -> None:
        self.verdicts: Counter[tuple[str, Status]] = Counter()
        """Number of verdicts by rule and status."""
        self.runs = self.vehicles = self.files = self.troubles = self._doubts = 0
        self._left: dict[str, int] = {}

    def trouble(self, sentence: str) -> None:
        """Count and print a file or run that could not be read or judged."""
        self.troubles += 1
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
        self.verdicts.update((v.rule, v.status) for v in answer.verdicts)

    def finish(self, batch: Batch) -> bool:
        """Count a part of a file, and return whether the file is finished."""
        left = self._left.pop(batch.file, batch.total) - len(batch.answers)
        if left > 0 and not batch.error:
            self._left[batch.file] = left
            return False
        self.files += 1
        return True

    def lines(self) -> list[str]:
        """Return the numbers of verdicts as a table, and the sums."""
        statuses = [status for status in Status if any(s is status for _, s in self.verdicts)]
        rules = list(dict.fromkeys(rule for rule, _ in self.verdicts))
        wide = max(map(len, rules), default=0)
        lines = [" " * wide + "".join(f"{status.value:>8}" for status in statuses)] if rules else []
        lines += [f"{rule:{wide}}" + "".join(f"{self.verdicts[rule, s] or '':>8}" for s in statuses) for rule in rules]
        return [*map(str.rstrip, lines), self.sums]

    @property
    def sums(self) -> str:
        """The numbers of judged runs and vehicles, in a sentence."""
        told = f"{_several(self.runs, 'run')}, {_several(self.vehicles, 'vehicle')} judged"
        return f"{told}; {_several(self.troubles, 'thing')} could not be read or judged" if self.troubles else told

    def exit_status(self, *, told: bool) -> int:
        """Return the exit status; if a program reads the verdicts (`told`), the statuses 1 and 5 are not used."""
        found = {status for _, status in self.verdicts}
        if self.troubles:
            return 2
        if told:
            return 0
        if not found & {Status.PASS, Status.FAIL, Status.OPEN}:
            why = "every verdict that applies is UNSURE" if Status.UNSURE in found else "no rule applies to any of these runs"
            warn(f"rvads: nothing was judged: {why}")
            return 5
        return 1 if found & {Status.FAIL, Status.OPEN} else 0


def _several(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"
