"""The command ``rvads replay``: draws the replay page of a failure of an earlier session, or of a run in a file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pytest_rvads.cli.common import Subparsers, progress, say, share, warn
from pytest_rvads.support.errors import RunError, RvadsError
from pytest_rvads.support.wording import first, one_line, plural, quoted

if TYPE_CHECKING:
    from pytest_rvads.cli.replayed import Replayed
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Report


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads replay`` to the parser."""
    parser = commands.add_parser(
        "replay",
        help="draw the replay page of a failure from its kept run; without arguments list the failures of the latest session",
        description="A session of pytest keeps the runs of all failures in its folder, .rvads/N, and draws the first runs. "
        "Exit status: 0; 1 if --all could not draw a page; 2 if there is no such session, failure or run.",
    )
    parser.add_argument(
        "what",
        nargs="?",
        metavar="ITEM|RUN",
        help="id of a failed item, or a part of the id that no other id has; or the file of a run that --rvads-keep wrote",
    )
    parser.add_argument("--session", metavar="N|DIR", help="number or folder of the session (default: the latest in .rvads)")
    share(
        parser,
        "rules",
        default=[],
        help="only failures of this rule; or the rule that judges the file of a run; or a file of your rules (.rules)",
    )
    parser.add_argument("--all", action="store_true", help="draw every failure that has no page yet")
    share(parser, "baseline", help="report of an earlier session; its run is drawn faintly below")
    share(parser, "output", help="page to write (default: in the folder of the session), or an animated picture (.svg)")
    parser.set_defaults(command=_replay)


@dataclass(frozen=True, slots=True)
class _Session:
    """A session that has ended, read from its folder."""

    folder: Path
    report: Report
    earlier: tuple[Path, Report] | None = None
    """Path and content of the report of an earlier session, whose runs are shown below the runs of this session."""

    @property
    def failed(self) -> list[Record]:
        """The records of the test items that failed."""
        return [record for record in self.report.records if record.failed]

    def page(self, record: Record) -> Path:
        """Return the path of the replay page of a failure, whether the page exists or not."""
        from pytest_rvads.support.storage import slug

        return self.folder / f"{slug(record.nodeid)}.html"

    def unseen(self, record: Record) -> str:
        """Return the reason why no replay of a failure can be drawn; empty if a replay can be drawn."""
        from pytest_rvads.report.folders import run_file

        if not record.hash or not record.shows:
            return "no rule was violated"
        try:
            return "" if run_file(self.folder, record.hash).exists() else "its run is not kept"
        except RunError as error:
            return f"its record is damaged, {error}"

    def replayed(self, record: Record, page: Path) -> Replayed:
        """Return the replay of a failure."""
        from pytest_rvads.cli.replayed import failed_run

        if why := self.unseen(record):
            again = f"{self.report.again} {quoted(record.nodeid)}"
            raise RunError(f"{record.nodeid}: {why}, so there is no replay of it; run it again: {again}")
        return failed_run(self.folder, self.report, record, page, self.earlier)


def _replay(options: argparse.Namespace) -> int:
    from pytest_rvads.logic.rules.book import load_rules
    from pytest_rvads.report.files import load
    from pytest_rvads.runs.readers import READERS

    what = options.what or ""
    if options.all and options.output:
        raise RvadsError("--all writes many pages, each into the folder of the session: leave --output out")
    for name in options.rules:
        if name.endswith(".rules"):
            load_rules(name)
    options.rule, *more = [name for name in options.rules if not name.endswith(".rules")] or [None]
    if more:
        raise RvadsError(f"a replay is about one rule, --rules names {options.rule!r} and {more[0]!r}: name one of them")
    if Path(what).suffix.lower() in READERS and "::" not in what:
        from pytest_rvads.cli.replayed import run_of_file

        file = Path(what)
        if options.session or options.all or options.baseline:
            raise RvadsError(
                f"{file} is the file of a run, which belongs to no session: leave --session, --all and --baseline out"
            )
        page = Path(f"{file.stem}{f'-{options.rule}' if options.rule else ''}.html")
        _write_replay(run_of_file(file, options.rule), Path(options.output or page))
        return 0
    session = _session(options.session)
    if not (what or options.all or options.rule or options.output):
        return _print_failures(session)
    if options.baseline:
        session = replace(session, earlier=(Path(options.baseline), load(Path(options.baseline))))
    failed = [r for r in session.failed if options.rule in (None, r.verdicts[-1].rule if r.verdicts else r.rule)]
    chosen = [r for r in failed if r.nodeid == what] or [r for r in failed if what in r.nodeid]
    if options.all:
        return _draw_all(session, chosen)
    record = _single_failure(chosen, session, what, options.rule)
    page = session.page(record)
    path = Path(options.output or page)
    _write_replay(session.replayed(record, path), path)
    if page.exists():
        _link_pages(session)
    return 0


def _write_replay(shown: Replayed, path: Path) -> None:
    """Write the page of a replay, or an animated picture (.svg), and print the path and the message of the verdict."""
    from pytest_rvads.support.storage import write_file

    if shown.doubt:
        warn(f"rvads: {shown.doubt}")
    if path.suffix == ".svg":
        write_file(path, shown.animation().encode())
        say(path.as_posix())
    else:
        write_file(path, shown.page().encode())
        say(f"{path.as_posix()}{'' if shown.time is None else f'#t={shown.time:.2f}'}")
    if shown.verdict is not None:
        say(f"  {shown.verdict.message}")


def _session(which: str | None) -> _Session:
    from pytest_rvads.report.files import load
    from pytest_rvads.report.folders import REPORT, ROOT, sessions

    number = which if which is not None and which.isascii() and which.isdecimal() else ""
    root = Path(ROOT) if number or which is None else Path(which)
    if which and not number and (root / REPORT).exists():
        return _Session(root, load(root / REPORT))
    folders = {folder.name: folder for folder in sessions(root)}
    if not folders:
        raise RvadsError(
            f"no session of pytest has left anything in {root}: run pytest in this folder first, or name the folder of a session "
            "by --session"
        )
    if number and number not in folders:
        raise RvadsError(f"there is no session {number} in {root}, there are {first(list(folders), None)}")
    folder = folders[number] if number else list(folders.values())[-1]
    if not (folder / REPORT).exists():
        ended = [ended_folder for ended_folder in folders.values() if (ended_folder / REPORT).exists()]
        other = f"; the last session with a report is --session {ended[-1]}" if ended else ""
        raise RvadsError(f"the session of {folder} has not ended, or died, so it has left no {REPORT}{other}")
    return _Session(folder, load(folder / REPORT))


def _print_failures(session: _Session) -> int:
    from pytest_rvads.report.folders import option

    failures, report = session.failed, session.report
    began = f"began {report.began}, " if report.began else ""
    say(f"{session.folder.as_posix()}: {began}{len(failures):,} of {plural(len(report.records), 'item')} failed")
    undrawn, session_option = 0, option(session.folder)
    for record in failures:
        drawn, why = session.page(record).exists(), session.unseen(record)
        undrawn += not (drawn or why)
        look = f"{session.page(record).as_posix()}{_time_fragment(record)}" if drawn else why or "not drawn yet"
        say(f"{record.status:<10} {one_line(record.nodeid)}  {look}")
    if undrawn:
        say(
            f'rvads replay {session_option} "ID" draws a failure by its id or a part of its id; '
            f"rvads replay {session_option} --all draws all failures"
        )
    return 0


def _time_fragment(record: Record) -> str:
    time = record.verdicts[-1].time if record.verdicts else None
    return "" if time is None else f"#t={time:.2f}"


def _single_failure(chosen: Sequence[Record], session: _Session, what: str, rule: str | None) -> Record:
    from pytest_rvads.report.folders import option

    if len(chosen) == 1:
        return chosen[0]
    request = " and ".join([f"{what!r} in the id"] * bool(what) + [f"{rule!r} as its rule"] * bool(rule))
    matching = f" with {request}" if request else ""
    if chosen:
        names = first([record.nodeid for record in chosen], 3)  # more would hide the sentence
        raise RvadsError(
            f"{session.folder} has {plural(len(chosen), 'failure')}{matching}: name a longer part of an id, or --all: {names}"
        )
    passed = next((r for r in session.report.records if what and what in r.nodeid and rule in (None, r.rule)), None)
    if passed:
        raise RvadsError(
            f"{passed.nodeid} did not fail in {session.folder}, it is {passed.status}, and only runs of failures are kept: "
            "--rvads-keep=DIR keeps all runs"
        )
    raise RvadsError(f"{session.folder} has no failure{matching}: `rvads replay {option(session.folder)}` lists its failures")


def _draw_all(session: _Session, chosen: Sequence[Record]) -> int:
    """Draw the replays of all failures without a page; a failure that can't be drawn does not stop the drawing."""
    from pytest_rvads.support.storage import write_file

    undrawn, failed_pages = [record for record in chosen if not session.page(record).exists()], 0
    for number, record in enumerate(undrawn, 1):
        try:
            page = session.page(record)
            write_file(page, session.replayed(record, page).page().encode())
        except (RvadsError, OSError) as error:
            warn(f"rvads: {' '.join(str(error).split())}")
            failed_pages += 1
        progress(number, len(undrawn), "pages")
    if len(undrawn) > failed_pages:
        _link_pages(session)
    existing = len(chosen) - len(undrawn)
    before = f", {existing:,} drawn before" if existing else ""
    say(f"{session.folder.as_posix()}: {plural(len(undrawn) - failed_pages, 'page')} drawn{before}")
    return 1 if failed_pages else 0


def _link_pages(session: _Session) -> None:
    """Write the page of a session again with links to all its replays, if the page can be written."""
    from msgspec import structs

    from pytest_rvads.report.files import save
    from pytest_rvads.report.folders import INDEX, REPORT

    records = []
    for record in session.report.records:
        page = session.page(record)
        at = record.look[record.look.find("#") :] if "#" in record.look else _time_fragment(record)
        look = f"{page.as_posix()}{at}" if record.failed and page.exists() else ""
        records.append(structs.replace(record, look=look) if look else record)
    report = replace(session.report, records=tuple(records))
    with suppress(OSError):
        for name in (INDEX, REPORT):
            save(session.folder / name, report)
