"""The process of SUMO, from our side: started when it is needed, used for run after run, replaced when it has failed."""

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
from pytest_rvads.errors import RunError
from pytest_rvads.satellites.sumo import libsumo_server
from pytest_rvads.satellites.sumo.road_network import Network
from pytest_rvads.simulators.choice import choice
from pytest_rvads.wording import one_line

__all__ = ["SumoFailed", "SumoProcess", "acquire", "release"]

_DAY = 86400.0
"""Where the session sets no limit [s]."""
_OPTIONS = (
    "--step-length=0.01",
    "--no-step-log",
    "--duration-log.disable",
    "--xml-validation=never",
    "--xml-validation.net=never",
    "--time-to-teleport=-1",  # who waits for long is not taken elsewhere
    "--collision.action=none",  # who touches whom is judged by the bodies
    "--insertion-checks=none",  # everybody starts where and as fast as the case says
)


class SumoFailed(RunError):
    """SUMO ended, hung, or refused a request.

    Args:
        text: one sentence.
        detail: what it last wrote to its standard error.
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
            # Not the folder of the program: what libsumo imports is not looked for among our modules.
            self._child = Child([sys.executable, "-P", libsumo_server.__file__, str(self._folder)])
        except StackError as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise SumoFailed(f"SUMO (libsumo): {error}") from None

    @property
    def usable(self) -> bool:
        """Whether it can simulate."""
        return not self._closed and self._child.running

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._child.pid

    def load(self, network: Network, routes: str, names: list[str], others: list[str], seed: int) -> array[float]:
        """Begin a simulation, and return the first row: where the vehicles are when they have departed."""
        return self._ask(do="load", options=self._options(network, routes, seed), names=names, others=others)

    def step(self, count: int, moved: Mapping[str, Sequence[float]], gone: list[str]) -> array[float]:
        """Take so many steps and return a row of each; see `pytest_rvads.satellites.sumo.libsumo_server`."""
        return self._ask(do="step", count=count, moved=moved, gone=gone)

    def brake(self, network: Network, routes: str, name: str) -> float:
        """Return how far a lone vehicle gets that is told to stop at once [m]; inf where the road is too short."""
        return self._ask(do="brake", options=self._options(network, routes, 0), name=name)[0]

    def close(self) -> None:
        """End the process."""
        self._closed = True
        if self.owner == os.getpid():
            self._child.close()
            shutil.rmtree(self._folder, ignore_errors=True)

    def _options(self, network: Network, routes: str, seed: int) -> list[str]:
        """Write the files of a simulation, and return its options.

        Raises:
            SumoFailed: they can't be written.
        """
        net, departures = self._folder / network.name, self._folder / "departures.rou.xml"
        try:
            if not net.exists():
                net.write_bytes(network.text)
            departures.write_text(routes, encoding="utf-8")
        except OSError as error:  # somebody cleans up, or the disk is full
            raise self._failed(f"its files can't be written to {self._folder}: {error.strerror}") from None
        # By their names alone: the server works in the folder, and SUMO takes a comma in a path for the end of it.
        return [*_OPTIONS, f"--net-file={net.name}", f"--route-files={departures.name}", f"--seed={seed}"]

    def _ask(self, **request: Any) -> array[float]:
        """Send a request and return the numbers of the answer.

        Raises:
            SumoFailed: there is none within the limit for decisions, or it is that the request failed.
        """
        limit = choice().limits.decision or _DAY
        try:
            self._child.send(json.dumps(request).encode() + b"\n", limit)
            head = json.loads(self._child.line(limit))
            numbers = array("d", self._child.exactly(8 * head["numbers"], limit))
        except StackTimeout:
            raise self._failed(f"no answer within {limit:g} s of real time (--rvads-decision-limit)") from None
        except StackError as error:
            raise self._failed(f"{error}") from None
        except BaseException:  # somebody does not want to wait any longer: an answer may still come
            self.close()
            raise
        if wrong := head.get("error"):
            raise self._failed(one_line(wrong, 300))
        return numbers

    def _failed(self, why: str) -> SumoFailed:
        detail = self._child.tail()
        self.close()
        return SumoFailed(f"SUMO (libsumo): {why}", detail)  # without numbers: the reason is part of the run's hash


_FREE: list[SumoProcess] = []
"""Running processes that no simulation uses: starting one takes a third of a second."""
_PARENTS: list[SumoProcess] = []
"""SUMO processes of the parent of a forked process. They are kept alive here, because their destructor would end them."""


def acquire() -> SumoProcess:
    """Return a process that no other simulation uses."""
    while _FREE:
        process = _FREE.pop()
        if process.usable:
            return process
        process.close()
    return SumoProcess()


def release(process: SumoProcess) -> None:
    """Give a process back for the next simulation."""
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
