"""What a stack is told of a scenario before it drives: the content of the message ``reset``, as builtins."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from pytest_rvads.conduct.stretches import conflicts
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.junctions.junction import Junction, JunctionControl
from pytest_rvads.maps.segment import Pose, Segment
from pytest_rvads.runs.itineraries import Itinerary

__all__ = ["reset"]


def reset(seen: Observation, period: float) -> dict[str, Any]:
    """Return the content of the reset message for the run that begins with `seen`.

    Args:
        seen: the first observation.
        period: time between two observations [s].
    """
    itinerary, vehicle = seen.itinerary, seen.vehicle
    return {
        "type": "reset",
        "name": seen.me.name,
        "period": period,
        "speed_limit": seen.speed_limit,
        "vehicle": {
            "length": vehicle.length,
            "width": vehicle.width,
            "wheelbase": vehicle.wheelbase,
            "rear_axle_offset": vehicle.rear_axle_offset,
            "drive": vehicle.drive,
            "brake": vehicle.brake[seen.aggression - 1],
            "steering_limit": vehicle.steering_limit,
            "steering_rate": vehicle.steering_rate,
        },
        "itinerary": {
            "entrance": itinerary.entrance,
            "exit": itinerary.exit,
            "turn": itinerary.turn.value,
            "line": itinerary.line,
            "length": itinerary.length,
            "end": itinerary.end,
            "path": _path(itinerary),
        },
        "map": _map(seen.junction),
    }


def _path(itinerary: Itinerary) -> tuple[tuple[float, float, float, float], ...]:
    """Return the centre line of an itinerary by the metre: station, x, y [m], heading [rad]."""
    first = -itinerary.origin
    stations = [first + k for k in range(int(itinerary.end - first))] + [itinerary.end]
    return tuple((s, *itinerary.pose(s)) for s in stations)


@lru_cache(maxsize=64)
def _map(junction: Junction) -> dict[str, Any]:
    """Return a junction as builtins: its arms and lanes, what regulates them, who gives way to whom, where the lanes are."""
    ways = range(junction.ways)
    geometry = junction.geometry
    index = {way: number for number, way in enumerate(junction.movements)}
    return {
        "junction": junction.name,
        "control": junction.control.value,
        "left_hand": junction.left_hand,
        "arms": [{"entrances": [arm], "exits": [arm]} for arm in ways],
        "entrances": [
            {
                "arm": arm,
                "lane": 0,
                "sign": _sign(junction, arm),
                "setback": junction.setbacks[arm],
                "path": [] if geometry is None else _points(geometry.approaches[arm]),
            }
            for arm in ways
        ],
        "exits": [{"arm": k, "lane": 0, "path": [] if geometry is None else _points(geometry.exits[k])} for k in ways],
        "right_of": sorted(junction.right_of),
        "opposite": sorted(junction.opposite),
        "movements": [
            {
                "entrance": m.entrance,
                "exit": m.exit,
                "turn": m.turn.value,
                "length": m.length,
                "path": [] if geometry is None else _points(geometry.movements[m.entrance, m.exit]),
            }
            for m in junction.movements.values()
        ],
        "conflicts": sorted((index[one], index[other]) for one, other in conflicts(junction) or ()),
        "yields": [],
    }


def _sign(junction: Junction, entrance: int) -> str:
    """Return what stands at an entrance; where only some have lights, those that have a phase."""
    lit = any(entrance in group for group in junction.phase_groups)
    return "lights" if lit else "stop" if junction.control is JunctionControl.STOP else "none"


def _points(segment: Segment) -> list[Pose]:
    """Return x, y [m], heading [rad] along a centre line, by two metres."""
    stations = [float(s) for s in range(0, int(segment.length), 2)] + [segment.length]
    return [segment.pose(s) for s in stations]
