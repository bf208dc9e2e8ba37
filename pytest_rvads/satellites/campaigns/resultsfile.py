"""The results of a campaign in a file with a line of JSON per case, so that results need no memory and outlive the process.

Lines stand in the order in which results arrived; `Results` yields the results in the order of the cases. The first line, the
head, names the code of this package and of the driver, the rules and the versions. A campaign is continued in a file only if both
have equal heads, so that a file never holds results of different code.
"""

from __future__ import annotations

import os
import time
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from io import BufferedReader, FileIO
from itertools import chain
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, cast

import msgspec

from pytest_rvads.logic.judging.verdicts import outcome_of
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Count, Record, SimulatedItem, by_rule
from pytest_rvads.report.session_report import Report, exit_status
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.support.decoding import decode, encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.storage import open_file
from pytest_rvads.support.wording import shown

try:
    import fcntl
except ImportError:  # not a POSIX system: the file is not locked
    fcntl = None  # type: ignore[assignment]

FORMAT, VERSION = "rvads-campaign", 2
_PATIENCE = 3.0
"""Longest wait for the worker processes of a killed campaign, which close its file as soon as they notice its end [s]."""


class Head(msgspec.Struct, frozen=True, kw_only=True):
    """Facts about all results of a campaign: the first line of its file, and later lines that add facts."""

    format: str = FORMAT
    version: int = VERSION
    made: dict[str, str]
    """Names and hashes of what results depend on, by the words ``package``, ``rules``, ``simulator``, ``driver``, ``bodies``."""
    drivers: dict[str, str]
    """Identity of each driver, by name of the driver."""
    versions: dict[str, str]
    """Version of each package on which results depend, by name of the package."""
    cases: Count | None = None
    """Number of cases of the campaign; None until the campaign has ended."""
    results: Count = 0
    """Number of results when the campaign ended; a file with fewer results is incomplete."""
    unfit: dict[str, int] = {}
    """Per junction, the number of cases that were left out because a vehicle has no room at its start."""

    def differs(self, other: Head) -> str:
        """Return the names of the values in which two heads differ; a driver that only one head names is no difference."""
        pairs = [(word, self.made.get(word), other.made.get(word)) for word in {**self.made, **other.made}]
        pairs += [(f"version of {name}", version, other.versions.get(name)) for name, version in self.versions.items()]
        pairs += [(f"code or values of {name}", key, other.drivers.get(name, key)) for name, key in self.drivers.items()]
        return ", ".join(word for word, own_value, other_value in pairs if own_value != other_value)


class Judged(SimulatedItem, frozen=True, kw_only=True, omit_defaults=True, tag="judged"):
    """The result of a case of a campaign: its run with the verdict of every rule, in the order of the rules.

    The id is the id of the run. Every verdict of a case that could not be simulated is ERROR. `by_rule` makes a record per rule.
    """

    case: str
    """Hash of the case; a case with a result is not run again."""
    number: Count = 0
    """Position of the case in the campaign."""
    line: Count = 0
    test: str = ""
    rotation: Count = 0
    seat: Count | None = None
    traffic: str | None = None
    rule: str | None = None
    requirements: tuple[str, ...] = ()
    status: Outcome = Outcome.NOT_RUN
    known: str | None = None
    outcome: str = ""
    message: str = ""

    @property
    def name(self) -> str:
        """Id of the run: the id of a test item without the name of the rule."""
        return self.nodeid


class _Judgement(msgspec.Struct):
    status: Outcome
    unavoidable: bool = False
    provoked: bool = False

    @property
    def outcome(self) -> Outcome:
        return outcome_of(self.status, self.unavoidable, self.provoked)


class Glance(msgspec.Struct):
    """The fields of a `Judged` that are read when a file is opened: hash and number of the case, and outcomes of its verdicts."""

    case: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    number: Count = 0
    verdicts: tuple[_Judgement, ...] = ()


class Results:
    """The results of a campaign so far, one per case in the order of the cases; every iteration reads the results from disk.

    Memory holds some 300 bytes per case: the hash and the number of the case, and the position of its line in the file.

    Args:
        path: the file; None for a temporary file, which is deleted when this process ends.
        head: facts about the results that will be added to the file; None to open the file only for reading.

    Raises:
        RvadsError: the file holds no results, or results of another campaign, or another process adds to the file.
        OSError: the file can't be opened.
    """

    def __init__(self, path: str | os.PathLike[str] | None, head: Head | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.verdicts = 0
        """Number of verdicts of all cases."""
        self._file = _open_results(self.path, head is not None)
        weakref.finalize(self, self._file.close)
        self._index: dict[bytes, tuple[int, int, int]] = {}
        """By hash of the case, the number of the case, and offset and length of its line [bytes]."""
        self.outcomes: set[Outcome] = set()
        """The outcomes of all verdicts."""
        try:
            file_head = self._scan()
            if file_head is None and head is not None:
                line = b"\n" + encode(head)
                self._file.seek(0)
                # The file is empty, or the write of its head was interrupted.
                if line.startswith(self._file.read(len(line)) + self._file.read(1)):
                    self._file.truncate(0)
                    self._append(encode(head))
                    file_head = head
            if file_head is None or (file_head.format, file_head.version) != (FORMAT, VERSION):
                raise RvadsError(
                    f"{self.path} holds no results of a campaign of version {VERSION}: name such a file, or a new file"
                )
            differs = "" if head is None else file_head.differs(head)
            if differs:
                raise RvadsError(f"{self.path} holds results of another campaign ({differs}): name another file, or remove it")
            self.head = file_head
        except BaseException:
            self._file.close()
            raise

    def _scan(self) -> Head | None:
        """Index the lines with results, and return the last head; damaged lines, such as a line that was cut off, are ignored."""
        head: Head | None = None
        self._file.seek(0)
        lines, place = BufferedReader(self._file, 2**20), 0
        while line := lines.readline(2**26):  # [bytes]
            try:
                if line.startswith(b'{"format"'):
                    head, earlier_head = msgspec.json.decode(line, type=Head), head
                    if earlier_head is not None and (differs := earlier_head.differs(head)):
                        raise RvadsError(
                            f"{self.path} holds results of several campaigns ({differs}): name a file with results of one"
                        )
                elif head is not None and line != b"\n":
                    self._index_line(line, place)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                pass
            if head is None and line != b"\n":
                break
            place += len(line)
        lines.detach()
        return head

    def _index_line(self, line: bytes, place: int) -> bool:
        """Index a line with a result, given its offset in the file, and return whether its case is new."""
        glance = msgspec.json.decode(line, type=Glance)
        key = bytes.fromhex(glance.case)
        if key in self._index:
            return False
        self._index[key] = glance.number, place, len(line)
        self.verdicts += len(glance.verdicts)
        self.outcomes.update(verdict.outcome for verdict in glance.verdicts)
        return True

    def add(self, line: bytes) -> None:
        """Write a result (a `Judged` in JSON) to disk at once; a second result of the same case is dropped.

        Raises:
            RvadsError: the result can't be written, for example for lack of room.
        """
        if self._index_line(line, self._file.seek(0, os.SEEK_END) + 1):
            self._append(line)

    def tell(self, head: Head) -> None:
        """Append a head, a line of facts about all results, to the file if the head is new.

        Raises:
            RvadsError: the head can't be written.
        """
        if head != self.head:
            self._append(encode(head))
            self.head = head

    def _append(self, line: bytes) -> None:
        full_line = b"\n" + line  # the line end comes first, because the last line of the file may have been cut off
        try:
            self._file.seek(0, os.SEEK_END)
            written_length, trouble = self._file.write(full_line), "there is no room"
        except OSError as error:
            written_length, trouble = 0, str(error)
        if written_length != len(full_line):
            raise RvadsError(
                f"no result can be added to {self.path or 'the folder for temporary files'} ({trouble}): make room, then run the "
                "campaign again, it continues after its last result"
            )

    def holds(self, case: str) -> bool:
        """Return whether a case has a result, given the hash of the case."""
        return bytes.fromhex(case) in self._index

    def lines(self) -> Iterator[bytes]:
        """Yield the results in JSON as on disk, in the order of the cases."""
        for _, key in sorted((number, key) for key, (number, _, _) in self._index.items()):
            _, place, length = self._index[key]
            self._file.seek(place)
            yield self._file.read(length)

    def __len__(self) -> int:
        return len(self._index)

    def __iter__(self) -> Iterator[Judged]:
        for line in self.lines():
            yield decode(line, Judged, f"{self.path} is damaged", RvadsError)

    def records(
        self, looks: Mapping[str, str] | None = None, flaky: Mapping[str, Divergence] | None = None
    ) -> Collection[Record]:
        """Return the records, one per case and rule; every iteration over this collection reads the file.

        Args:
            looks: by id of a record, the path of its replay page.
            flaky: by name of a run, how it differed when it was simulated again; its failed records are FLAKY.
        """
        return _Records(self, looks or {}, flaky or {})

    @property
    def complete(self) -> bool:
        """Whether the campaign has ended and the file holds all its results."""
        return self.head.cases is not None and len(self) >= self.head.results

    @property
    def exitstatus(self) -> int:
        """Exit status: 0 for no failure, 1 for a failure, 2 for results that are not `complete`, 5 if nothing was judged."""
        return exit_status(self.outcomes, complete=self.complete)

    def report(self, again: str = "") -> Report:
        """Return the report of the campaign, with the records of `records`.

        Args:
            again: the beginning of a command that runs a case again; the report appends the quoted id of the case. With an empty
                text, the report shows the id alone.
        """
        note = f"INCOMPLETE: the campaign has not come to its end, {len(self):,} cases are judged; run it again to continue"
        return Report(
            self.records(),
            versions=self.head.versions,
            exitstatus=self.exitstatus,
            notes=() if self.complete else (note,),
            unfit=dict(self.head.unfit),
            complete=self.complete,
            again=again,
        )

    def _repr_html_(self) -> str:
        return shown(self.report())

    def release(self) -> None:
        """Unlock the file, so that other processes can add to the file."""
        if fcntl:
            fcntl.flock(self._file, fcntl.LOCK_UN)

    def close(self) -> None:
        """Close the file; results can no longer be read."""
        self._file.close()

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Records(Collection[Record]):
    """The records of a campaign; every iteration makes them from the file, because they can be larger than memory."""

    def __init__(self, results: Results, looks: Mapping[str, str], flaky: Mapping[str, Divergence]) -> None:
        self._results, self._looks, self._flaky = results, looks, flaky

    def __iter__(self) -> Iterator[Record]:
        for record in chain.from_iterable(map(by_rule, self._results)):
            look, difference = self._looks.get(record.nodeid, ""), self._flaky.get(record.run or "")
            if record.failed and difference:
                yield msgspec.structs.replace(record, look=look, status=Outcome.FLAKY, flaky=difference)
            else:
                yield msgspec.structs.replace(record, look=look) if look else record

    def __len__(self) -> int:
        return self._results.verdicts

    def __contains__(self, record: object) -> bool:
        return any(item == record for item in self)


def joined(paths: Sequence[str | os.PathLike[str]]) -> Results:
    """Return the results of several files of a campaign, for reading; of a case in several files, the first result is taken."""
    if len(paths) == 1:
        return Results(paths[0])
    all_results: Results | None = None
    for path in paths:
        with Results(path) as part:
            if all_results is None:
                all_results = Results(None, part.head)
            elif differs := all_results.head.differs(part.head):
                raise RvadsError(f"{path} holds results of another campaign than {paths[0]} ({differs}): make a report of each")
            for line in part.lines():
                all_results.add(line)
            # The joined campaign has ended if all campaigns have ended.
            head, other = all_results.head, part.head
            ended = None if head.cases is None or other.cases is None or not part.complete else max(head.cases, other.cases)
            names = sorted({**head.unfit, **other.unfit})
            unfit = {name: max(head.unfit.get(name, 0), other.unfit.get(name, 0)) for name in names}
            drivers, results = head.drivers | other.drivers, max(head.results, other.results)
            all_results.tell(msgspec.structs.replace(head, drivers=drivers, cases=ended, results=results, unfit=unfit))
    if all_results is None:
        raise RvadsError("no file of results is named: name at least one file")
    return all_results


def _open_results(path: Path | None, add: bool) -> FileIO:
    """Open a file of results without a buffer; with `add`, the file is locked, so that no other process adds results."""
    if path is None:
        return TemporaryFile(buffering=0)
    if not add:
        return cast(BufferedReader, open_file(path)).detach()  # type: ignore[return-value]
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not path.is_file():
        raise RvadsError(f"{path} is no regular file, so nothing can be read back from it: name another file for results")
    file = FileIO(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b")
    until = time.monotonic() + _PATIENCE
    while fcntl:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except BlockingIOError:
            if time.monotonic() > until:
                file.close()
                raise RvadsError(f"another campaign writes to {path}: wait for its end, or name another file") from None
            time.sleep(0.1)
    return file
