"""The process of SUMO as seen by its parent: started on demand, used for many runs, and replaced after a failure."""

from __future__ import annotations

import atexit
import json
import os
import shutil
import sys
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from pytest_rvads.drivers.stacks.child import Child, StackError, StackTimeout
from pytest_rvads.satellites.sumo import libsumo_server
from pytest_rvads.satellites.sumo.road_network import Network
from pytest_rvads.simulators.choice import choice
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import one_line

__all__ = ["SumoFailed", "SumoProcess", "acquire", "release"]

_NO_LIMIT = 86400.0
"""Limit of an answer if the session sets no limit [s]."""
_OPTIONS = (
    "--step-length=0.01",
    "--no-step-log",
    "--duration-log.disable",
    "--xml-validation=never",
    "--xml-validation.net=never",
    "--time-to-teleport=-1",  # never move a waiting vehicle elsewhere
    "--collision.action=none",  # contacts are found by the boxes of the vehicles
    "--insertion-checks=none",  # keep the positions and speeds of the case
)


class SumoFailed(RunError):
    """SUMO ended, hung, or refused a request.

    Args:
        text: the reason in a sentence.
        detail: the last lines of SUMO's standard error.
    """

    def __init__(self, text: str, detail: str = "") -> None:
        super().__init__(text)
        self.detail = detail


class SumoProcess:
    """A running process of SUMO."""

    def __init__(self) -> None:
        try:
            self._folder = Path(mkdtemp(prefix="rvads-sumo-"))
        except OSError as error:
            raise SumoFailed(f"SUMO (libsumo): no folder for its files can be made: {error}") from None
        self._closed = False
        self.owner = os.getpid()
        try:
            # -P keeps the folder of the program out of sys.path, so that libsumo imports no module of this package.
            self._child = Child([sys.executable, "-P", libsumo_server.__file__, str(self._folder)])
        except StackError as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise SumoFailed(f"SUMO (libsumo): {error}") from None

    @property
    def usable(self) -> bool:
        """Whether the process can simulate."""
        return not self._closed and self._child.running

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._child.pid

    def load(self, network: Network, routes: str, names: list[str], others: list[str], seed: int) -> array[float]:
        """Begin a simulation, and return the first row, with the motions of the vehicles after their departure."""
        return self._ask(do="load", options=self._options(network, routes, seed), names=names, others=others)

    def step(self, count: int, moved: Mapping[str, Sequence[float]], gone: list[str]) -> array[float]:
        """Take `count` steps and return a row of each; `libsumo_server` explains rows and arguments."""
        return self._ask(do="step", count=count, moved=moved, gone=gone)

    def brake(self, network: Network, routes: str, name: str) -> float:
        """Return the braking distance of a vehicle alone on a road [m]; infinite if the road is too short."""
        return self._ask(do="brake", options=self._options(network, routes, 0), name=name)[0]

    def close(self) -> None:
        """End the process."""
        self._closed = True
        if self.owner == os.getpid():
            self._child.close()
            shutil.rmtree(self._folder, ignore_errors=True)

    def _options(self, network: Network, routes: str, seed: int) -> list[str]:
        """Write the files of a simulation, and return the options of SUMO.

        Raises:
            SumoFailed: the files can't be written.
        """
        net, departures = self._folder / network.name, self._folder / "departures.rou.xml"
        try:
            if not net.exists():
                net.write_bytes(network.text)
            departures.write_text(routes, encoding="utf-8")
        except OSError as error:  # the folder was removed, or the disk is full
            raise self._failed(f"its files can't be written to {self._folder}: {error.strerror}") from None
        # Names without folders: the server works in the folder, and SUMO ends a path at a comma.
        return [*_OPTIONS, f"--net-file={net.name}", f"--route-files={departures.name}", f"--seed={seed}"]

    def _ask(self, **request: Any) -> array[float]:
        """Send a request and return the numbers of the answer.

        Raises:
            SumoFailed: SUMO gave no answer within the limit for decisions, or the request failed.
        """
        limit = choice().limits.decision or _NO_LIMIT
        try:
            self._child.send(json.dumps(request).encode() + b"\n", limit)
            head = json.loads(self._child.line(limit))
            numbers = array("d", self._child.exactly(8 * head["numbers"], limit))
        except StackTimeout:
            raise self._failed(f"no answer within {limit:g} s of real time (--rvads-decision-limit)") from None
        except StackError as error:
            raise self._failed(f"{error}") from None
        except BaseException:  # after an interrupt, an answer to this request may still come
            self.close()
            raise
        if message := head.get("error"):
            raise self._failed(one_line(message, 300))
        return numbers

    def _failed(self, why: str) -> SumoFailed:
        detail = self._child.tail()
        self.close()
        return SumoFailed(f"SUMO (libsumo): {why}", detail)  # no numbers that vary, because the reason is part of the run's hash


_FREE: list[SumoProcess] = []
"""Running processes without a simulation, kept because starting a process takes a third of a second."""
_PARENTS: list[SumoProcess] = []
"""SUMO processes of the parent of a forked process. They are kept alive here, because their destructor would end them."""


def acquire() -> SumoProcess:
    """Return a free process, or start a process."""
    while _FREE:
        process = _FREE.pop()
        if process.usable:
            return process
        process.close()
    return SumoProcess()


def release(process: SumoProcess) -> None:
    """Return a process to the free processes, for the next simulation."""
    if process.usable:
        _FREE.append(process)


def _forked() -> None:
    _PARENTS.extend(_FREE)
    _FREE.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


@atexit.register
def _close_all() -> None:
    while _FREE:
        _FREE.pop().close()
