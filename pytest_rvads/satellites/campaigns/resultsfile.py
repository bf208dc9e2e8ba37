"""The results of a campaign on disk: a line of JSON per case, added as they come, so that they need no memory and outlive us.

Lines stand in the order of arrival; readers get results in the order of the cases.
"""

from __future__ import annotations

import os
import time
import weakref
from array import array
from collections.abc import Collection, Iterator, Sequence
from io import BufferedReader, FileIO
from itertools import chain
from pathlib import Path
from tempfile import TemporaryFile
from typing import cast

import msgspec
import numpy as np

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record
from pytest_rvads.report.run_record import by_rule
from pytest_rvads.report.session_report import Anew, Report, exit_status
from pytest_rvads.satellites.campaigns.judged import FORMAT, VERSION, Glance, Head, Judged
from pytest_rvads.support.decoding import decode, encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.storage import open_file

try:
    import fcntl
except ImportError:  # not a POSIX system: nobody is kept out
    fcntl = None  # type: ignore[assignment]

__all__ = ["Results", "joined"]

_HEAD = b'{"format"'
"""How a line begins that is no result."""
_LONGEST = 2**26
"""Longest line that is read [bytes]."""
_PATIENCE = 3.0
"""Longest time in which the processes of a killed campaign notice its end and close its file [s]."""


class Results:
    """The results of a campaign so far, one per case in the order of the cases; each access reads them from disk.

    Memory holds the hash, the number and the place of the line of each case: some 150 bytes.

    Args:
        path: the file; None for a file without a name, which ends with this process.
        head: head of the results that will be added; None to read only.

    Raises:
        RvadsError: the file holds no results, or results of another campaign, or another process adds to it.
        OSError: the file can't be opened.
    """

    def __init__(self, path: str | os.PathLike[str] | None, head: Head | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.verdicts = 0
        """Number of verdicts of all cases."""
        self._file = _opened(self.path, head is not None)
        weakref.finalize(self, self._file.close)
        self._known: set[bytes] = set()
        self._index = array("q"), array("q"), array("q"), array("q")
        """Per result: number of the case, beginning of its hash, begin of the line and its length [bytes]."""
        self._outcomes: set[Outcome] = set()
        try:
            self.head = self._begun(head)
        except BaseException:
            self._file.close()
            raise

    def _begun(self, head: Head | None) -> Head:
        """Read the file and return its head; an empty file gets `head`."""
        found = self._scanned()
        if found is None and head is not None and self._is_begun(b"\n" + encode(head)):
            self._file.truncate(0)
            self._append(encode(head))
            return head
        if found is None or (found.format, found.version) != (FORMAT, VERSION):
            raise RvadsError(f"{self.path} holds no results of a campaign of version {VERSION}: name such a file, or a new one")
        differs = "" if head is None else found.differs(head)
        if differs:
            raise RvadsError(f"{self.path} holds results of another campaign ({differs}): name another file, or remove this one")
        return found

    def _is_begun(self, line: bytes) -> bool:
        """Return whether the file is empty, or holds only the beginning of a line that was cut off."""
        self._file.seek(0)
        return line.startswith(self._file.read(len(line)) + self._file.read(1))

    def _scanned(self) -> Head | None:
        """Index all lines and return the last head; other lines, such as a line that was cut off, are ignored.

        Raises:
            RvadsError: the file has results of several campaigns.
        """
        found: Head | None = None
        self._file.seek(0)
        lines, place = BufferedReader(self._file, 2**20), 0
        while line := lines.readline(_LONGEST):
            try:
                if line.startswith(_HEAD):
                    found, before = msgspec.json.decode(line, type=Head), found
                    if before is not None and (differs := before.differs(found)):
                        raise RvadsError(
                            f"{self.path} holds results of several campaigns ({differs}): name a file with those of one"
                        )
                elif found is not None and line != b"\n":
                    self._note(line, place)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                pass
            if found is None and line != b"\n":
                break
            place += len(line)
        lines.detach()
        return found

    def _note(self, line: bytes, place: int) -> bool:
        """Index the place of a line, and return whether its case is new."""
        glance = msgspec.json.decode(line, type=Glance)
        key = bytes.fromhex(glance.case)
        if key in self._known:
            return False
        self._known.add(key)
        for column, value in zip(self._index, (glance.number, int.from_bytes(key[:7]), place, len(line)), strict=True):
            column.append(value)
        self.verdicts += len(glance.verdicts)
        self._outcomes.update(verdict.outcome for verdict in glance.verdicts)
        return True

    def add(self, line: bytes) -> None:
        """Write a result (a `Judged` in JSON) to disk at once; a second result of a case is left out.

        Raises:
            RvadsError: the result can't be written, for example for lack of room.
        """
        if self._note(line, self._file.seek(0, os.SEEK_END) + 1):
            self._append(line)

    def tell(self, head: Head) -> None:
        """Write a head with further facts about all results.

        Raises:
            RvadsError: the head can't be written.
        """
        if head != self.head:
            self._append(encode(head))
            self.head = head

    def _append(self, line: bytes) -> None:
        whole = b"\n" + line  # the line end comes first: it closes one that was cut off
        try:
            self._file.seek(0, os.SEEK_END)
            written, trouble = self._file.write(whole), "there is no room"
        except OSError as error:
            written, trouble = 0, str(error)
        if written != len(whole):
            raise RvadsError(
                f"the results in {self.path or 'the folder for temporary files'} can't be added to ({trouble}): make room, then "
                "run the campaign again, it goes on where it was"
            )

    def holds(self, case: str) -> bool:
        """Return whether a case has a result, given the hash of the case."""
        return bytes.fromhex(case) in self._known

    def lines(self) -> Iterator[bytes]:
        """Yield the results as they are on disk, JSON each, in the order of the cases."""
        numbers, keys, places, lengths = (np.array(column, np.int64) for column in self._index)
        for k in np.lexsort((keys, numbers)):
            self._file.seek(int(places[k]))
            yield self._file.read(int(lengths[k]))

    def __len__(self) -> int:
        return len(self._known)

    def __iter__(self) -> Iterator[Judged]:
        for line in self.lines():
            yield decode(line, Judged, f"{self.path} is damaged", RvadsError)

    def records(self) -> Collection[Record]:
        """Return a record per case and rule, made from what is on disk in every pass."""
        return Anew(lambda: chain.from_iterable(map(by_rule, self)), lambda: self.verdicts)

    @property
    def complete(self) -> bool:
        """Whether the campaign came to its end, and no line is damaged that it had written by then."""
        return self.head.cases is not None and len(self) >= self.head.results

    @property
    def exitstatus(self) -> int:
        """As of sessions: 0 if all is well, 1 if something is wrong, 2 if it is not `complete`, 5 if nothing was judged."""
        return exit_status(self._outcomes, whole=self.complete)

    def report(self, again: str = "") -> Report:
        """Return what a session would report of it; its records are those of `records`.

        Args:
            again: the command that runs a case once more, when its id follows in quotes; where none does, ids stand alone.
        """
        note = f"INCOMPLETE: the campaign has not come to its end, {len(self):,} cases are judged; run it again, it goes on"
        return Report(
            self.records(),
            versions=self.head.versions,
            exitstatus=self.exitstatus,
            notes=() if self.complete else (note,),
            unfit=dict(self.head.unfit),
            complete=self.complete,
            again=again,
        )

    def release(self) -> None:
        """Let others add to the file."""
        if fcntl:
            fcntl.flock(self._file, fcntl.LOCK_UN)

    def close(self) -> None:
        """Let go of the file; nothing can be read after that."""
        self._file.close()

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def joined(paths: Sequence[str | os.PathLike[str]]) -> Results:
    """Return the results of several files of one campaign, each case once, to read; of a single file itself.

    Raises:
        RvadsError: a file is none of a campaign, or one of another campaign than the first.
        OSError: a file can't be read.
    """
    if len(paths) == 1:
        return Results(paths[0])
    whole: Results | None = None
    for path in paths:
        with Results(path) as part:
            if whole is None:
                whole = Results(None, part.head)
            elif differs := whole.head.differs(part.head):
                raise RvadsError(f"{path} holds results of another campaign than {paths[0]} ({differs}): make a report of each")
            for line in part.lines():
                whole.add(line)
            head = part.head if part.complete else msgspec.structs.replace(part.head, cases=None)
            whole.tell(whole.head.with_part(head))
    if whole is None:
        raise RvadsError("no file of results is named: name one or more")
    return whole


def _opened(path: Path | None, add: bool) -> FileIO:
    """Return the file, without a buffer; of one that is to be added to, for this process alone."""
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
