"""A scenario as OpenSCENARIO XML: everybody where it starts, as fast, with a route, for somebody else's controller to drive."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from pytest_rvads.decoding import encode
from pytest_rvads.errors import ScenarioError, require
from pytest_rvads.maps.segment import Pose
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.satellites.openscenario.document import Actor, Document, body_of, moved_back
from pytest_rvads.satellites.openscenario.mapfile import mapped, put_map
from pytest_rvads.satellites.openscenario.phases import phases_of_plan
from pytest_rvads.satellites.openscenario.playedfile import Site
from pytest_rvads.satellites.openscenario.run_export import write
from pytest_rvads.satellites.openscenario.writing import library
from pytest_rvads.scenarios.case import Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.wording import one_line

__all__ = ["VERSION", "ScenarioNote", "save_scenario"]

VERSION = 1


class ScenarioNote(msgspec.Struct, frozen=True):
    """What a file says of a scenario beside its elements: what only we know of."""

    version: int
    site: Site
    scenario: Mapping[str, Any]
    """See `Scenario.record`."""


def save_scenario(
    scenario: Scenario, path: str | Path, *, map: str | os.PathLike[str] | None = None, fleet: Fleet | None = None
) -> None:
    """Write a scenario as OpenSCENARIO XML 1.2, and the map that its junction is from beside it; equal ones give equal files.

    Vehicles are declared in the order in which they are created, teleported to their starts, given their speeds and assigned
    their routes; the lights follow their plan; the end is that of the longest run. `load_scenario` reads the file.

    Args:
        scenario: what is to be driven.
        path: of the file, by convention ``.xosc``; folders are made.
        map: OpenDRIVE file that the junction is from; by default the one that it says itself.
        fleet: the bodies; passenger cars by default.

    Raises:
        ScenarioError: a vehicle does not fit on its approach.
        MapError: it is not known which map the junction is from.
        RvadsError: the library scenariogeneration is not installed, or the file can't be written.
    """
    require(scenario, Scenario, "save_scenario takes a rvads.Scenario(rvads.find('stop4'), '1133')", ScenarioError)
    require(fleet, Fleet | None, "fleet= must be a rvads.Fleet(vehicle)", ScenarioError)
    library()
    path, bodies = Path(path), fleet or Fleet()
    place = mapped(scenario.place, map)
    rows = list(zip(scenario.agents(), scenario.itineraries(), scenario.starts(bodies.of), strict=True))
    created = scenario.creation.index
    actors = []
    for agent, way, (distance, speed) in sorted(rows, key=lambda row: created(row[0].entrance)):
        vehicle = bodies.of(agent.name)
        body = body_of(replace(agent, kind=vehicle.kind), vehicle)
        start = moved_back(_placed(way, way.start(distance), body.back), body.back)
        ahead = [way.pose(station) for station in (0.0, way.length / 2, way.length, way.leave)]
        actors.append(Actor(agent.name, body, start, speed, route=(start, *ahead)))
    site = Site(scenario.place.name, scenario.place.id, scenario.place.digest)
    note = ScenarioNote(VERSION, site, scenario.record())
    document = Document(
        one_line(scenario.describe()),
        put_map(place, path.parent),
        ("rvads.scenario", encode(note).decode()),
        tuple(actors),
        phases_of_plan(place, scenario.signals()),
        scenario.duration,
    )
    write(path, document)


def _placed(way: Itinerary, station: float, back: float) -> Pose:
    """Return the pose of a front at a station; the rear axle stands on the centre line, too, as where we simulate."""
    front, axle = way.pose(station), way.pose(station - back)
    return Pose(front.x, front.y, math.atan2(front.y - axle.y, front.x - axle.x))
