"""Makes scenarios from the records of `Scenario.record` in run files and exports."""

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
    """Return the scenario of a record.

    Args:
        record: a record of `Scenario.record`; its fields about the junction are ignored.
        place: the junction of the scenario.
        where: the beginning of the error message.

    Raises:
        ScenarioError: a field is missing or impossible.
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
