"""Attach a driving stack in Python to pytest-rvads: this file is all there is to it.

    import rvads_client

    for seen in rvads_client.connect("my stack", rate=20):
        seen.answer(target_speed=8.0)

The loop ends when the session does. With the first observation of a new scenario ``seen.fresh`` is true: forget what you
know of the last one. ``seen.scenario`` is the reset message: map with arms, lanes, signs and movements, itinerary, vehicle.
With ``connect(..., pedestrians=True)`` you are also told of pedestrians and crosswalks; else you drive without seeing them.
Whatever you print goes to standard error; the protocol has a descriptor of its own. SI units throughout, angles in radians
counter-clockwise.

Only the standard library is needed, Python 3.8 or later. Licence: Apache-2.0.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from typing import Any

VERSION = 2


class Observation:
    """What the vehicle sees, to be answered once.

    `time` [s]; `me` and `others`, vehicles as dicts (id, name, kind, entrance, lane, turn, zone, station, x, y, heading, speed,
    acceleration, length, width), where the id is one vehicle's throughout a run, 0 the own one's; `lights`, a colour per
    entrance; `scenario`, `fresh`.

    A stack that reads pedestrians also has `pedestrians`, and `parked` vehicles before crosswalks, as dicts (id, name, kind,
    crosswalk, side, zone, station, x, y, heading, speed, acceleration, length, width); and `walks`, the colour of the pedestrian
    light of every crosswalk. The station of a pedestrian counts from the kerb that it comes from.
    """

    def __init__(self, content: dict[str, Any], scenario: dict[str, Any], fresh: bool, output: Any) -> None:
        self.time = content["time"]
        self.me = content["me"]
        self.others = content["others"]
        self.lights = content["lights"]
        self.pedestrians = content.get("pedestrians", [])
        self.parked = content.get("parked", [])
        self.walks = content.get("walks", [])
        self.scenario = scenario
        self.fresh = fresh
        self._step = content["step"]
        self._output = output
        self._since = time.perf_counter()

    def conflicts_with(self, other: dict[str, Any]) -> bool:
        """Tell whether the own movement can't be made together with one that the vehicle `other` may make."""
        return self._meets(other, "conflicts")

    def gives_way_to(self, other: dict[str, Any]) -> bool:
        """Tell whether the own movement gives way to one that the vehicle `other` may make."""
        return self._meets(other, "yields")

    def gap_ahead(self) -> float:
        """Return the free road to whoever drives ahead in the own lane, up to the end of the junction [m]; inf for nobody."""
        mine = [other for other in self.others if other["entrance"] == self.me["entrance"] and other["zone"] != "exit"]
        ahead = [other for other in mine if other["station"] > self.me["station"]]
        return min((other["station"] - other["length"] - self.me["station"] for other in ahead), default=float("inf"))

    def gap_to_pedestrians(self, soon: float = 4.0) -> float:
        """Return the free road up to the first crosswalk ahead on which somebody is, or soon will be, in the own lane [m].

        Soon is within so many seconds at the present speed. It is inf without anybody.
        """
        own, crosswalks, me = self._own_movements(), self.scenario["map"].get("crosswalks", []), self.me["station"]
        gap = float("inf")
        for cover in self.scenario["map"].get("covers", []):
            if cover["movement"] in own and cover["end"] >= me:
                strip, length = (cover["walk_start"], cover["walk_end"]), crosswalks[cover["crosswalk"]]["length"]
                people = [one for one in self.pedestrians if one["crosswalk"] == cover["crosswalk"]]
                if any(_in_strip(one, strip, length, soon) for one in people):
                    gap = min(gap, cover["start"] - me)
        return gap

    def limit_ahead(self, seconds: float) -> float:
        """Return the lower of the speed limits here and where the vehicle is `seconds` later at its present speed [m/s]."""
        ahead = self.me["station"] + seconds * self.me["speed"]
        return min(limit_at(self.scenario, station) for station in (self.me["station"], ahead))

    def _meets(self, other: dict[str, Any], relation: str) -> bool:
        ways, own = self.scenario["map"]["movements"], self._own_movements()
        pairs = (pair for pair in self.scenario["map"][relation] if pair[0] in own)
        return any(all(ways[two][what] == other[what] for what in ("entrance", "turn")) for _, two in pairs)

    def _own_movements(self) -> list[int]:
        ways, itinerary = self.scenario["map"]["movements"], self.scenario["itinerary"]
        return [k for k, way in enumerate(ways) if all(way[end] == itinerary[end] for end in ("entrance", "exit"))]

    def answer(self, **command: Any) -> None:
        """Answer with ``throttle, brake, steering``; ``target_speed``; ``acceleration`` (and ``steering``); or ``trajectory``.

        A trajectory is a list of (time, x, y); all but the controls are driven by the tracking controller.
        """
        _send(self._output, dict(command, type="command", step=self._step, compute=time.perf_counter() - self._since))


def connect(name: str, rate: float | None = None, pedestrians: bool = False) -> Iterator[Observation]:
    """Say hello and yield one observation after the other.

    Args:
        name: of the stack.
        rate: how often it wants to be asked [Hz]; None for the default.
        pedestrians: whether it wants to be told of pedestrians and crosswalks.
    """
    output = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    lines = os.fdopen(os.dup(0), "rb")
    if b'"protocol":"rvads"' not in lines.readline(4096):
        sys.exit("rvads: this program is to be started by pytest-rvads")
    hello = {"type": "hello", "version": VERSION, "name": name, "format": "json", "rate": rate, "pedestrians": pedestrians}
    _send(output, hello)
    scenario: dict[str, Any] = {}
    fresh = False
    for line in lines:
        try:
            content = json.loads(line)
            kind = content["type"]
            seen = Observation(content, scenario, fresh, output) if kind == "observe" else None
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            sys.exit(
                f"rvads: a message that can't be understood, use the client that belongs to this pytest-rvads: {error!r:.200}"
            )
        if kind == "reset":
            scenario, fresh = content, True
            _send(output, {"type": "ready"})
        elif seen is not None:
            yield seen
            fresh = False
        else:
            return


def limit_at(scenario: dict[str, Any], station: float) -> float:
    """Return the speed limit at a station of the own way [m/s]: of all that begin up to there, the last one holds."""
    limits = scenario["itinerary"]["speed_limits"]
    return float(max((limit for limit in limits if limit[0] <= station), default=limits[0])[1])


def _in_strip(person: dict[str, Any], strip: tuple[float, float], length: float, soon: float) -> bool:
    start, end = strip if person["side"] == "near" else (length - strip[1], length - strip[0])
    front, walked = person["station"], soon * person["speed"]
    return bool(front + max(walked, 0.0) > start and front - person["length"] + min(walked, 0.0) < end)


def stopping_speed(distance: float, deceleration: float = 2.0) -> float:
    """Return the speed from which braking at `deceleration` [m/s^2] ends after `distance` [m]; 0 from there on."""
    return (2.0 * deceleration * distance) ** 0.5 if distance > 0 else 0.0


def _send(output: Any, content: dict[str, Any]) -> None:
    data = json.dumps(content).encode() + b"\n"
    while data:
        data = data[output.write(data) :]
