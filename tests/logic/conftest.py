"""Runs written by hand: every vehicle by the ticks at which it changes zone, or by its motion."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from pytest_rvads.logic.ground import ground
from pytest_rvads.logic.ltl3 import synthesize
from pytest_rvads.logic.prepare import prepare
from pytest_rvads.maps.finder import find
from pytest_rvads.semantics.run import Collision, Run
from pytest_rvads.semantics.states import Agent, Colour, Zone

GREEN, YELLOW, RED = Colour.GREEN, Colour.YELLOW, Colour.RED

Make = Callable[..., Run]


@pytest.fixture(autouse=True)
def nothing_left_by_other_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test registers its own rules and builds its own monitors, so that it finds what it is there to find."""
    monkeypatch.setattr("pytest_rvads.logic.rules._USER", {})
    for cache in (ground, prepare, synthesize):
        cache.cache_clear()


@pytest.fixture(scope="session")
def make() -> Make:
    """Return a function that makes a run without positions.

    It takes the name of a built-in junction; per entrance the direction and the ticks at which the vehicle arrives, enters
    the junction and leaves it (None: never); the number of ticks; and per entrance [(tick, colour), ...].
    """

    def build(
        junction: str,
        vehicles: Mapping[int, tuple[int, int | None, int | None, int | None]],
        steps: int,
        lights: Mapping[int, Sequence[tuple[int, Colour]]] | None = None,
    ) -> Run:
        place = find(junction)
        agents, zones = [], []
        for entrance, (direction, *ticks) in vehicles.items():
            leaving = place.exit_of(entrance, direction)
            agents.append(Agent(f"a{entrance}", entrance, leaving, place.turn(entrance, leaving)))
            zone = np.full(steps, Zone.APPROACH, dtype=np.int8)
            for tick, part in zip(ticks, (Zone.ENTRANCE, Zone.JUNCTION, Zone.EXIT), strict=True):
                if tick is not None:
                    zone[tick:] = part
            zones.append(zone)
        colours = np.zeros((steps, place.ways), dtype=np.int8)
        for entrance in lights or {}:
            for tick, colour in (lights or {})[entrance]:
                colours[tick:, entrance] = colour
        return Run("by-hand", place, tuple(agents), np.column_stack(zones), colours)

    return build


@pytest.fixture(scope="session")
def drive() -> Make:
    """Return a function that makes a run with positions from speeds.

    It takes the name of a built-in junction; per entrance the direction, the station at the start [m], and [(tick, speed
    [m/s]), ...]; the number of ticks; lights as in `make`; collisions as (tick, name, name).
    """

    def build(
        junction: str,
        vehicles: Mapping[int, tuple[int, float, Sequence[tuple[int, float]]]],
        steps: int,
        lights: Mapping[int, Sequence[tuple[int, Colour]]] | None = None,
        collisions: Sequence[tuple[int, str, str]] = (),
        **meta: Any,
    ) -> Run:
        place = find(junction)
        agents, columns = [], []
        for entrance, (direction, start, speeds) in vehicles.items():
            leaving = place.exit_of(entrance, direction)
            agents.append(Agent(f"a{entrance}", entrance, leaving, place.turn(entrance, leaving)))
            speed = np.zeros(steps)
            for tick, value in speeds:
                speed[tick:] = value
            station = start + np.concatenate(([0.0], np.cumsum(speed[:-1]))) * 0.01
            line, length = -place.setbacks[entrance], place.movements[entrance, leaving].length
            zone = np.select(
                [station < line - 1.0, station <= 0.0, station < length], [Zone.APPROACH, Zone.ENTRANCE, Zone.JUNCTION], Zone.EXIT
            )
            columns.append((zone.astype(np.int8), station, speed))
        colours = np.zeros((steps, place.ways), dtype=np.int8)
        for entrance in lights or {}:
            for tick, colour in (lights or {})[entrance]:
                colours[tick:, entrance] = colour
        zone, station, speed = (np.column_stack([c[k] for c in columns]) for k in range(3))
        return Run(
            "by-hand",
            place,
            tuple(agents),
            zone,
            colours,
            station=station,
            speed=speed,
            pose=np.zeros((steps, len(agents), 3)),
            collisions=tuple(Collision(tick * 0.01, (one, two), 1.0) for tick, one, two in collisions),
            meta={"speed_limit": 11.176, "vehicle": {"length": 4.6, "width": 1.86}, **meta},
        )

    return build
