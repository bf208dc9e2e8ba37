"""The replays that ``rvads replay`` draws: of a failure in a session, from its kept run, or of a run in a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pytest_rvads.cli.common import named_rules
from pytest_rvads.logic.check import check, other_verdicts
from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.rules.book import get_rule
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.animated import animated
from pytest_rvads.report.failures import Beside, earlier_run, facts, moment, summed, usual_rules
from pytest_rvads.report.folders import INDEX, run_file
from pytest_rvads.report.record import Record, RecordedItem
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.scenarios.ids import recalled
from pytest_rvads.support.errors import FormulaError, RunError, RvadsError
from pytest_rvads.support.installed import load
from pytest_rvads.support.wording import quoted


@dataclass(frozen=True, slots=True)
class Replayed:
    """A run with the verdict and the texts that its replay shows."""

    run: Run
    verdict: Verdict | None
    """The verdict of the shown rule; None if no rule judges the run."""
    rule: Rule | None
    """The rule whose monitors are shown; None if no monitors are shown."""
    notes: str
    beside: Beside
    doubt: str = ""
    """Reason why the replay of a failure can't show the monitors of the rule; empty without such a reason."""

    @property
    def time(self) -> float | None:
        """The time that shows best what the verdict is about, on the clock of the recording [s]."""
        return None if self.verdict is None else moment(self.run, self.verdict)

    def page(self) -> str:
        """Return the replay page of the run as HTML."""
        if self.verdict is None:
            return str(load("pages", "replay")(self.run, self.run.label, self.notes, beside=self.beside))
        # No rule has an empty name, so a page for the empty name shows no monitors.
        return str(next(load("pages", "failure")(self.run, self.verdict, self.rule or "", self.notes, self.beside)).html)

    def animation(self) -> str:
        """Return an animated SVG of the seconds around the time that shows best what the verdict is about."""
        title, responsible = (self.run.label, ()) if self.verdict is None else (self.verdict.message, self.verdict.responsible)
        return animated(self.run, title=title, responsible=responsible, around=self.time)


def failed_run(folder: Path, report: Report, record: Record, page: Path, earlier: tuple[Path, Report] | None) -> Replayed:
    """Return the replay of a test item that violated a rule, with its run in an `earlier` report (file and content), if any."""
    path = run_file(folder, record.hash or "")
    run, again = load_run(path), f"{report.again} {quoted(record.nodeid)}"
    if run.hash != record.hash:
        raise RunError(f"{path} holds another run than that of {record.nodeid}: run it again: {again}")
    verdict, doubt = record.verdicts[-1], ""
    rule: Rule | None = None
    try:
        rule = get_rule(verdict.rule)
    except FormulaError:
        doubt = f"{verdict.rule!r} is a rule of your own, so its monitors are not shown: name its file by --rules, if it has one"
    else:
        now = check(run, rule)
        if now.status is verdict.status:
            verdict = now
        else:
            rule, session = None, f"the session said {verdict.status} by {verdict.rule}"
            doubt = f"{session}, and this version says {now.status}: the page shows the verdict of the session"
    scenario = run.provenance.get("scenario")
    start = record.recording if isinstance(record, RecordedItem) else record.run or ""
    if isinstance(scenario, Mapping):
        with suppress(RvadsError):  # another version of this package wrote the scenario
            start = recalled(scenario, run.junction, "scenario").describe()
    origin_lines = [f"{word:<9} {text}" for word, text in facts(record, start, "") if word not in ("rule", "requirements")]
    notes = "\n".join(
        (verdict.explanation or verdict.message, *origin_lines, *([f"note      {doubt}"] if doubt else []), f"rerun     {again}")
    )
    ghost = None
    if earlier and run.excerpt is None:
        ghost = earlier_run(earlier[1], earlier[0].parent, Path(), record.nodeid, run)
    same_run = (r for r in report.records if r.hash == record.hash and r.test == record.test and r.variant == record.variant)
    recorded = {v.rule: v for r in same_run for v in r.verdicts if v.rule != record.verdicts[-1].rule}
    others = summed(recorded.values()) or summed(other_verdicts(run, usual_rules(run), verdict.rule))
    back = os.path.relpath(folder / INDEX, page.parent).replace(os.sep, "/") if (folder / INDEX).exists() else ""
    beside = Beside(facts(record, start, again), others, back, ghost, earlier[0].name if earlier and ghost else "")
    return Replayed(run, verdict, rule, notes, beside, doubt)


def run_of_file(file: Path, rule_name: str | None) -> Replayed:
    """Return the replay of the run of a file; with None as `rule_name`, no rule judges the run."""
    rules = named_rules((rule_name,)) if rule_name else ()
    if len(rules) > 1:
        raise FormulaError(f"a page shows one rule, got {rule_name!r} with {len(rules)} rules: name one of these rules")
    runs = read_runs(file)
    if len(runs) != 1:
        raise RunError(
            f"{file} holds {len(runs)} runs, expected one run: `rvads check {quoted(str(file))} -o DIR` draws several runs"
        )
    run, verdict = runs[0], check(runs[0], rules[0]) if rules else None
    again = f"rvads replay {quoted(str(file))}{f' --rules {rule_name}' if rule_name else ''}"
    rows = [("recorded", str(file)), *([("rule", f"{rules[0].name}: {rules[0].title}")] if rules else []), ("rerun", again)]
    notes = "\n".join((*([] if verdict is None else [verdict.explanation]), f"recorded  {file}", f"rerun     {again}"))
    others = summed(other_verdicts(run, usual_rules(run), rules[0].name if rules else ""))
    return Replayed(run, verdict, rules[0] if rules else None, notes, Beside(tuple(rows), others))
