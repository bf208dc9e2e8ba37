"""What a stack is told of a scenario before it drives: the content of the message ``reset``, as builtins."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.junctions.junction import Junction
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
            "speed_limits": [(at, itinerary.limit_at(at)) for at, _ in itinerary.limits or ((-itinerary.origin, None),)],
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
    """Return a junction as builtins: its arms, lanes, signs and lights, the yields between movements, and the centre lines."""
    index = {key: number for number, key in enumerate(junction.movements)}
    between = {pair for pair in junction.conflicts or () if junction.movements.keys() >= {*pair}}
    reasons = {(index[a], index[b]): why.value for (a, b), why in (junction.yields or {}).items() if (a, b) in between}
    return {
        "junction": junction.name,
        "control": junction.control.value,
        "left_hand": junction.left_hand,
        "arms": [arm._asdict() for arm in junction.arms],
        "entrances": [
            {
                "arm": e.arm,
                "lane": e.lane,
                "sign": e.sign.value,
                "phase": e.phase,
                "setback": e.setback,
                "sign_setback": e.sign_setback,
                "path": _points(e.approach),
            }
            for e in junction.entrances
        ],
        "exits": [{"arm": e.arm, "lane": e.lane, "path": _points(e.road)} for e in junction.exits],
        "right_of": sorted(junction.right_of),
        "opposite": sorted(junction.opposite),
        "movements": [
            {"entrance": m.entrance, "exit": m.exit, "turn": m.turn.value, "length": m.length, "path": _points(m.path)}
            for m in junction.movements.values()
        ],
        "conflicts": sorted((index[one], index[other]) for one, other in between),
        "yields": sorted(reasons),
        "reasons": [reasons[pair] for pair in sorted(reasons)],
    }


def _points(segment: Segment | None) -> list[Pose]:
    """Return x, y [m], heading [rad] along a centre line, by two metres; nothing where it is not known."""
    if segment is None:
        return []
    stations = [float(s) for s in range(0, int(segment.length), 2)] + [segment.length]
    return [segment.pose(s) for s in stations]
