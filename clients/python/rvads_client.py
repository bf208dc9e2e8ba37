"""Attach a driving stack in Python to pytest-rvads: this file is all there is to it.

    import rvads_client

    for seen in rvads_client.connect("my stack", rate=20):
        seen.answer(target_speed=8.0)

The loop ends when the session does. With the first observation of a new scenario ``seen.fresh`` is true: forget what you
know of the last one. ``seen.scenario`` is the reset message: map with arms, lanes, signs and movements, itinerary, vehicle.
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
    """

    def __init__(self, content: dict[str, Any], scenario: dict[str, Any], fresh: bool, output: Any) -> None:
        self.time = content["time"]
        self.me = content["me"]
        self.others = content["others"]
        self.lights = content["lights"]
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

    def limit_ahead(self, seconds: float) -> float:
        """Return the lower of the speed limits here and where the vehicle is `seconds` later at its present speed [m/s]."""
        ahead = self.me["station"] + seconds * self.me["speed"]
        return min(limit_at(self.scenario, station) for station in (self.me["station"], ahead))

    def _meets(self, other: dict[str, Any], relation: str) -> bool:
        ways, itinerary = self.scenario["map"]["movements"], self.scenario["itinerary"]
        own = [k for k, way in enumerate(ways) if all(way[end] == itinerary[end] for end in ("entrance", "exit"))]
        pairs = (pair for pair in self.scenario["map"][relation] if pair[0] in own)
        return any(all(ways[two][what] == other[what] for what in ("entrance", "turn")) for _, two in pairs)

    def answer(self, **command: Any) -> None:
        """Answer with ``throttle, brake, steering``; ``target_speed``; ``acceleration`` (and ``steering``); or ``trajectory``.

        A trajectory is a list of (time, x, y); all but the controls are driven by the tracking controller.
        """
        _send(self._output, dict(command, type="command", step=self._step, compute=time.perf_counter() - self._since))


def connect(name: str, rate: float | None = None) -> Iterator[Observation]:
    """Say hello and yield one observation after the other.

    Args:
        name: of the stack.
        rate: how often it wants to be asked [Hz]; None for the default.
    """
    output = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    lines = os.fdopen(os.dup(0), "rb")
    if b'"protocol":"rvads"' not in lines.readline(4096):
        sys.exit("rvads: this program is to be started by pytest-rvads")
    _send(output, {"type": "hello", "version": VERSION, "name": name, "format": "json", "rate": rate})
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


def stopping_speed(distance: float, deceleration: float = 2.0) -> float:
    """Return the speed from which braking at `deceleration` [m/s^2] ends after `distance` [m]; 0 from there on."""
    return (2.0 * deceleration * distance) ** 0.5 if distance > 0 else 0.0


def _send(output: Any, content: dict[str, Any]) -> None:
    data = json.dumps(content).encode() + b"\n"
    while data:
        data = data[output.write(data) :]
