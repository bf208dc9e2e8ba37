"""Latency: a command takes effect some time after the observation that it answers."""

from __future__ import annotations

from collections import deque
from random import Random

from pytest_rvads.drivers.interface import Command, Control
from pytest_rvads.runs.run import DT
from pytest_rvads.scenarios.senses import Senses

__all__ = ["Latency"]


class Latency:
    """Commands on their way; none overtakes another, and before the first arrives the vehicle coasts.

    Args:
        senses: latency and jitter.
        key: what the random draws depend on beside the seed.
    """

    def __init__(self, senses: Senses, key: str) -> None:
        self._senses = senses
        self._random = Random(f"{senses.seed} {key} latency")
        self._coming: deque[tuple[int, Command]] = deque()
        self._held: Command = Control()

    def send(self, step: int, command: Command) -> None:
        """Send a command that answers the observation of `step`."""
        delay = self._senses.latency + self._senses.jitter * self._random.random()
        arrival = step + round(delay / DT)
        if self._coming:
            arrival = max(arrival, self._coming[-1][0])
        self._coming.append((arrival, command))

    def held(self, step: int) -> Command:
        """Return the command in effect in `step`."""
        while self._coming and self._coming[0][0] <= step:
            self._held = self._coming.popleft()[1]
        return self._held
