"""The recorder: collects the states of a simulation and turns them into a run.

A run under way keeps numbers, not objects. Values that many runs share (itineraries, tracks, versions) are computed once per
process and kept in bounded caches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pytest_rvads.drivers.interface import Control
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.run import Collision, Facts, Fault, Run
from pytest_rvads.runs.states import Agent, Colour, VehicleState, Zone

__all__ = ["Recorder"]

_STATION = VehicleState._fields.index("station")
_SPEED = VehicleState._fields.index("speed")


class Recorder:
    """Rows of states and controls, one column per agent.

    Plain numbers are kept, one after the other: tuples by the ten thousand would have the garbage collector at work.
    """

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents = tuple(agents)
        self._zones: list[Zone] = []
        self._motions: list[Any] = []
        self._lights: list[tuple[Colour, ...]] = []
        self._controls: list[float] = []

    def state(self, states: Sequence[VehicleState], lights: tuple[Colour, ...]) -> None:
        """Add a state: one `VehicleState` per agent, one colour per entrance."""
        zones, motions = self._zones, self._motions
        for state in states:
            zones.append(state.zone)
            motions += state[_STATION : _SPEED + 1]
        self._lights.append(lights)

    def control(self, controls: Sequence[Control]) -> None:
        """Add what was commanded in the step after the last state, per agent."""
        for control in controls:
            self._controls += control

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
        motion = np.fromiter(self._motions, dtype=np.float64).reshape(steps, count, 5)
        numbers = 3 * count
        controls = self._controls + (self._controls[-numbers:] or [0.0] * numbers)
        return Run(
            label=label,
            junction=junction,
            agents=self._agents,
            zone=np.frombuffer(bytes(self._zones), dtype=np.int8).reshape(steps, count),
            lights=np.frombuffer(b"".join(map(bytes, self._lights)), dtype=np.int8).reshape(steps, len(junction.starts)),
            station=motion[:, :, 0],
            speed=motion[:, :, 4],
            pose=motion[:, :, 1:4],
            controls=np.fromiter(controls[: steps * numbers], dtype=np.float64).reshape(steps, count, 3),
            collisions=collisions,
            fault=fault,
            facts=facts,
            provenance=provenance,
        )
