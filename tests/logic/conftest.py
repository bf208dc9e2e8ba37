"""Runs written by hand: every vehicle by the ticks at which it changes zone, or by its motion."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from pytest_rvads.logic.ground import ground
from pytest_rvads.logic.ltl3 import synthesize
from pytest_rvads.logic.prepare import prepare
from pytest_rvads.maps.finder import find
from pytest_rvads.semantics.itinerary import Itinerary
from pytest_rvads.semantics.run import Collision, Facts, Run
from pytest_rvads.semantics.states import Agent, Colour, Zone

GREEN, YELLOW, RED = Colour.GREEN, Colour.YELLOW, Colour.RED

Make = Callable[..., Run]


@pytest.fixture(autouse=True)
def nothing_left_by_other_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test registers its own rules and builds its own monitors, so that it finds what it is there to find."""
    for registry in ("rules._USER", "signature._PREDICATES"):
        monkeypatch.setattr(f"pytest_rvads.logic.{registry}.things", {})
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
    """Return a function that makes a run along the centre lines from speeds.

    It takes the name of a built-in junction; per entrance the direction, the station at the start [m], [(tick, speed
    [m/s]), ...], and how far to the left of the centre line to drive [m], 0 by default; the number of ticks; lights as in
    `make`; collisions as (tick, name, name); further facts.
    """

    def build(
        junction: str,
        vehicles: Mapping[int, tuple[Any, ...]],
        steps: int,
        lights: Mapping[int, Sequence[tuple[int, Colour]]] | None = None,
        collisions: Sequence[tuple[int, str, str]] = (),
        **facts: Any,
    ) -> Run:
        place = find(junction)
        agents, columns = [], []
        for entrance, (direction, start, speeds, *beside) in vehicles.items():
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
            itinerary = Itinerary.through(place, entrance, leaving)
            pose = np.array([itinerary.pose(float(s)) for s in station])
            pose[:, :2] += sum(beside) * np.stack((-np.sin(pose[:, 2]), np.cos(pose[:, 2])), axis=-1)
            columns.append((zone.astype(np.int8), station, speed, pose))
        colours = np.zeros((steps, place.ways), dtype=np.int8)
        for entrance in lights or {}:
            for tick, colour in (lights or {})[entrance]:
                colours[tick:, entrance] = colour
        zone, station, speed, pose = (np.stack([c[k] for c in columns], axis=1) for k in range(4))
        return Run(
            "by-hand",
            place,
            tuple(agents),
            zone,
            colours,
            station=station,
            speed=speed,
            pose=pose,
            collisions=tuple(Collision(tick * 0.01, (one, two), 1.0) for tick, one, two in collisions),
            facts=Facts(**{"sizes": ((4.6, 1.86),) * len(agents), "speed_limit": 11.176, **facts}),
        )

    return build
