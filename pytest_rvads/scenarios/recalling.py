"""Scenarios from their records: what `Scenario.record` gave, in run files and exports, as a scenario again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import msgspec

from pytest_rvads.decoding import typed
from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.senses import Senses

__all__ = ["recalled"]

_Lanes = Annotated[list[int], msgspec.Meta(max_length=100)]


class _Record(msgspec.Struct, frozen=True):
    directions: _Lanes
    distances: list[float]
    speeds: list[float]
    rotation: int
    configuration: str
    duration: float
    aggression: int
    wait: float
    subject: int | None
    order: _Lanes
    senses: dict[str, float | int | bool]
    followers: int = 0


def recalled(record: Mapping[str, Any], place: Junction, where: str) -> Scenario:
    """Return the scenario that a record is of.

    Args:
        record: as `Scenario.record` gives it; the fields for its junction are left to `place`.
        place: its junction.
        where: begins the message.

    Raises:
        ScenarioError: a field is missing or can't be.
    """
    found = typed(dict(record), _Record, where, ScenarioError)
    try:
        return Scenario(
            place,
            found.directions,
            distance=found.distances,
            speed=found.speeds,
            rotation=found.rotation,
            configuration=found.configuration,
            duration=found.duration,
            aggression=found.aggression,
            wait=found.wait,
            subject=found.subject,
            order=found.order,
            senses=Senses(**found.senses),  # type: ignore[arg-type]
            followers=found.followers,
        )
    except TypeError as error:
        raise ScenarioError(f"{where}: the field 'senses' has one that they don't: {error}") from error
    except ScenarioError as error:
        raise ScenarioError(f"{where}: {error}") from error
