"""A program that runs libsumo in its own process and answers requests with the motions of vehicles.

The program is started by its path and imports nothing of this package. The argument of the program is the path of its working
folder, which the program removes when it ends.

A request is a line of JSON with the name of a method of `Server` and the arguments of the method. The answer is a line of JSON,
followed by doubles in native byte order. The field ``numbers`` of the line is the number of doubles. The field ``error`` has the
reason if the request failed. The doubles are, per step and vehicle, x and y of the front bumper [m], the heading clockwise from
north [degrees] and the speed [m/s]; all four are not-a-number for a vehicle that has arrived at the end of its route.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from array import array
from collections.abc import Callable, Collection
from typing import Any


class Server:
    """A simulation of SUMO; `load` begins a simulation, and ends an earlier one."""

    def __init__(self, sumo: Any) -> None:
        self._sumo = sumo
        self._loaded = False
        self._names: list[str] = []
        self._driving: set[str] = set()

    def load(self, options: list[str], names: list[str], others: Collection[str] = ()) -> array[float]:
        """Load a network, let every vehicle depart, and return the motions of the vehicles after their departure.

        SUMO does not control the vehicles in `others`, whose positions each call of `step` sets.
        """
        if self._loaded:
            self._sumo.load(options)
        else:
            self._sumo.start(["sumo", *options])
            self._loaded = True
        self._names = names
        self._sumo.simulationStep()
        self._driving = set(self._sumo.vehicle.getIDList())
        if missing := [name for name in names if name not in self._driving]:
            raise RuntimeError(f"it does not let {', '.join(missing)} depart")
        for name in names:
            self._sumo.vehicle.setLaneChangeMode(name, 0)  # no lane changes: a route leads along one lane of each edge
        for name in others:
            self._sumo.vehicle.setSpeedMode(name, 0)  # SUMO must not change the speed of a vehicle that the caller moves
        return array("d", self._row())

    def step(self, count: int, moved: dict[str, list[float]], gone: list[str]) -> array[float]:
        """Take `count` steps and return the motions of all vehicles after each step.

        Before the first step, the vehicles in `moved` get their x, y, heading and speed, and the vehicles in `gone` are removed.
        """
        vehicle = self._sumo.vehicle
        for name in gone:
            if name in self._driving:
                vehicle.remove(name)
                self._driving.discard(name)
        for name, (x, y, heading, speed) in moved.items():
            if name in self._driving:
                vehicle.setSpeed(name, max(speed, 0.0))
                vehicle.moveToXY(name, "", -1, x, y, angle=heading, keepRoute=3)  # the route stays, the position is exact
        rows = array("d")
        for _ in range(count):
            self._sumo.simulationStep()
            self._driving.difference_update(self._sumo.simulation.getArrivedIDList())
            rows.extend(self._row())
        return rows

    def brake(self, options: list[str], name: str) -> array[float]:
        """Return the distance that a vehicle needs to stop if it brakes from its departure on [m].

        The distance is infinite if the vehicle reaches the end of the road before it stops.
        """
        self.load(options, [name])
        vehicle = self._sumo.vehicle
        start = vehicle.getLanePosition(name)
        vehicle.setSpeed(name, 0.0)
        while name in self._driving and vehicle.getSpeed(name) > 0.0:
            self.step(1, {}, [])
        return array("d", (vehicle.getLanePosition(name) - start,) if name in self._driving else (float("inf"),))

    def _row(self) -> list[float]:
        vehicle, row = self._sumo.vehicle, list[float]()
        for name in self._names:
            if name in self._driving:
                x, y = vehicle.getPosition(name)
                row += x, y, vehicle.getAngle(name), vehicle.getSpeed(name)
            else:
                row += (float("nan"),) * 4
        return row


def main() -> None:
    """Answer requests until the end of standard input, or until SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    # SUMO prints messages, so standard output is redirected to standard error, and answers go to a copy of standard output.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    import libsumo

    os.chdir(sys.argv[1])
    server = Server(libsumo)
    answers: dict[str, Callable[..., array[float]]] = {"load": server.load, "step": server.step, "brake": server.brake}
    try:
        for line in sys.stdin:
            request = json.loads(line)
            try:
                numbers = answers[request.pop("do")](**request)
                head: dict[str, Any] = {"numbers": len(numbers)}
            except (libsumo.TraCIException, libsumo.FatalTraCIError, RuntimeError) as error:
                head, numbers = {"numbers": 0, "error": f"{error}"}, array("d")
            out.write(json.dumps(head).encode() + b"\n" + numbers.tobytes())
            out.flush()
    finally:  # also runs after the end of the parent process, which closes standard input
        shutil.rmtree(sys.argv[1], ignore_errors=True)


if __name__ == "__main__":
    main()
