"""The recorder: collects the states of a simulation and turns them into a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.interface import Control
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.run import Collision, Facts, Fault, Run
from pytest_rvads.runs.states import Agent, Colour, VehicleState

__all__ = ["Recorder"]

_STATION = VehicleState._fields.index("station")
_SPEED = VehicleState._fields.index("speed")


class Recorder:
    """Rows of states and controls, one column per agent."""

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents = tuple(agents)
        self._states: list[VehicleState] = []
        self._lights: list[tuple[Colour, ...]] = []
        self._controls: list[Control] = []

    def state(self, states: Sequence[VehicleState], lights: tuple[Colour, ...]) -> None:
        """Add a state: one `VehicleState` per agent, one colour per entrance."""
        self._states += states
        self._lights.append(lights)

    def control(self, controls: Sequence[Control]) -> None:
        """Add what was commanded in the step after the last state, per agent."""
        self._controls += controls

    def run(
        self,
        label: str,
        junction: Junction,
        collisions: tuple[Collision, ...],
        fault: Fault | None,
        facts: Facts,
        provenance: Mapping[str, Any],
    ) -> Run:
        """Return the run. No step follows its last state, so the controls of the step before stand there again."""
        steps, count = len(self._lights), len(self._agents)
        # Station, x, y, heading and speed are neighbours in a VehicleState.
        motion = _numbers([s[_STATION : _SPEED + 1] for s in self._states]).reshape(steps, count, 5)
        held = self._controls[-count:] or [Control()] * count
        controls = (self._controls + held)[: len(self._states)]
        return Run(
            label=label,
            junction=junction,
            agents=self._agents,
            zone=np.frombuffer(bytes([s.zone for s in self._states]), dtype=np.int8).reshape(steps, count),
            lights=np.frombuffer(b"".join(map(bytes, self._lights)), dtype=np.int8).reshape(steps, len(junction.entrances)),
            station=motion[:, :, 0],
            speed=motion[:, :, 4],
            pose=motion[:, :, 1:4],
            controls=_numbers(controls).reshape(steps, count, 3),
            collisions=collisions,
            fault=fault,
            facts=facts,
            provenance=provenance,
        )


def _numbers(rows: Sequence[tuple[Any, ...]]) -> NDArray[np.float64]:
    """Return the numbers of all rows, one after the other; `numpy.array` takes several times as long for as many tuples."""
    return np.fromiter(chain.from_iterable(rows), dtype=np.float64)
