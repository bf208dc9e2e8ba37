"""Starts and uses processes of SUMO: a process is started on demand, used for many runs, and replaced after a failure."""

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
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import one_line

_OPTIONS = (
    "--step-length=0.01",
    "--no-step-log",
    "--duration-log.disable",
    "--xml-validation=never",
    "--xml-validation.net=never",
    "--time-to-teleport=-1",  # SUMO must not move a vehicle elsewhere that has waited long
    "--collision.action=none",  # SUMO must not react to collisions, which `SumoWorld` finds by the boxes of the vehicles
    "--insertion-checks=none",  # keep the positions and speeds of the case
)


class SumoFailed(RunError):
    """SUMO ended, hung, or refused a request; `detail` has the last lines of SUMO's standard error."""

    def __init__(self, text: str, detail: str = "") -> None:
        super().__init__(text)
        self.detail = detail


class SumoProcess:
    """A running process of SUMO; `limit` is the longest real time of an answer, 0 for no limit [s]."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
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
        """Whether the process of SUMO still runs, was not closed, and was not started by the parent of a forked process."""
        return not self._closed and self.owner == os.getpid() and self._child.running

    @property
    def pid(self) -> int:
        """Id of the process of SUMO."""
        return self._child.pid

    def load(self, network: Network, routes: str, names: list[str], others: list[str], seed: int) -> array[float]:
        """Begin a simulation, and return the motions of the vehicles after their departure."""
        return self._ask(do="load", options=self._options(network, routes, seed), names=names, others=others)

    def step(self, count: int, moved: Mapping[str, Sequence[float]], gone: list[str]) -> array[float]:
        """Simulate `count` steps and return the motions after each step; `Server.step` explains arguments and result."""
        return self._ask(do="step", count=count, moved=moved, gone=gone)

    def brake(self, network: Network, routes: str, name: str) -> float:
        """Return the distance that a single vehicle on a road needs to stop [m]; infinite if it does not stop on the road."""
        return self._ask(do="brake", options=self._options(network, routes, 0), name=name)[0]

    def close(self) -> None:
        """End the process of SUMO."""
        self._closed = True
        if self.owner == os.getpid():
            self._child.close()
            shutil.rmtree(self._folder, ignore_errors=True)

    def _options(self, network: Network, routes: str, seed: int) -> list[str]:
        """Write the files of a simulation, and return the options of SUMO."""
        net, departures = self._folder / network.name, self._folder / "departures.rou.xml"
        try:
            if not net.exists():
                net.write_bytes(network.text)
            departures.write_text(routes, encoding="utf-8")
        except OSError as error:  # the folder was removed, or the disk is full
            raise self._failed(f"its files can't be written to {self._folder}: {error.strerror}") from None
        # File names are given without the folder, in which the process works: SUMO takes a comma in a path for its end.
        return [*_OPTIONS, f"--net-file={net.name}", f"--route-files={departures.name}", f"--seed={seed}"]

    def _ask(self, **request: Any) -> array[float]:
        limit = self.limit or 86400.0  # without a limit, a day [s]
        try:
            self._child.send(json.dumps(request).encode() + b"\n", limit)
            head = json.loads(self._child.line(limit))
            numbers = array("d", self._child.exactly(8 * head["numbers"], limit))
        except StackTimeout:
            raise self._failed(f"no answer within {limit:g} s of real time (setting rvads_decision_limit)") from None
        except StackError as error:
            raise self._failed(f"{error}") from None
        except BaseException:  # after an interrupt, the answer could arrive late and be taken for the answer to another request
            self.close()
            raise
        if message := head.get("error"):
            raise self._failed(one_line(message, 300))
        return numbers

    def _failed(self, why: str) -> SumoFailed:
        detail = self._child.tail()
        self.close()
        return SumoFailed(f"SUMO (libsumo): {why}", detail)  # the reason is part of the run's hash: no numbers that vary


_FREE: list[SumoProcess] = []
"""Running processes that simulate nothing now; they are used again, because starting a process takes a third of a second."""


def acquire(limit: float) -> SumoProcess:
    """Return a running SUMO process that simulates nothing, with a `limit`; start a process if there is none."""
    while _FREE:
        process = _FREE.pop()
        if process.usable:
            process.limit = limit
            return process
        process.close()
    return SumoProcess(limit)


def release(process: SumoProcess) -> None:
    """Make a SUMO process available to the next call of `acquire`."""
    if process.usable:
        _FREE.append(process)


@atexit.register
def _close_all() -> None:
    while _FREE:
        _FREE.pop().close()
