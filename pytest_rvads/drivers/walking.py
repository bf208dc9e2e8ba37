"""Behaviours of pedestrians by name: how a pedestrian walks over a crosswalk while vehicles come.

A behaviour is deterministic: the speed of a pedestrian follows from what the pedestrian sees. All behaviours but one obey
pedestrian lights: the pedestrian starts on WALK (green) only, and finishes on flashing DON'T WALK (yellow).

Walking speeds: 1.4 m/s is the usual mean (1.3 to 1.4 m/s), and 2.5 m/s is running (2.2 to 3 m/s; Euro NCAP's running adult has
2.2 m/s).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

from pytest_rvads.runs.states import Colour
from pytest_rvads.support.errors import ScenarioError, suggest

WALKING, RUNNING = 1.4, 2.5
"""Speeds of walking and running [m/s]."""
STRIDE = 5.0
"""Acceleration with which pedestrians set out, stop and turn back [m/s^2]."""
KERB = 0.8
"""Distance before the kerb at which a pedestrian begins to stop [m]; stopping takes 0.2 m, and 0.6 m from running."""
_PAUSE = 4.0
"""Time for which a pedestrian who stops half way stands [s]."""
_SPARE = 1.0
"""Time that a careful pedestrian leaves between the end of the crossing and the arrival of a vehicle [s]."""
_YIELDING = 0.5
"""A vehicle slower than this before the crosswalk lets a pedestrian go [m/s]."""


class Approaching(NamedTuple):
    """A vehicle whose way leads over the crosswalk, and which has not passed the crosswalk."""

    distance: float
    """Distance from the front of the vehicle to the way of the pedestrian [m]; 0 or less while the vehicle is there."""
    speed: float
    """Speed of the vehicle [m/s]."""


class Sight(NamedTuple):
    """What a pedestrian sees."""

    time: float
    """Time since the pedestrian set out [s]."""
    station: float
    """Distance from the kerb where the pedestrian starts, along the crossing; negative before the kerb [m]."""
    length: float
    """Length of the crossing [m]."""
    light: Colour
    """Colour of the pedestrian light; NONE without a light."""
    vehicles: Iterable[Approaching]
    """The vehicles that come to the crosswalk, to be iterated once, because most behaviours ignore vehicles."""


Pace = Callable[[Sight], float]
"""Returns the walking speed that the pedestrian wants [m/s]; a negative speed leads back. Every pedestrian has a new `Pace`."""


class Behaviour(NamedTuple):
    """How a pedestrian walks."""

    make: Callable[[], Pace] | None = None
    """Makes the pace of a pedestrian; None if the pedestrian walks on at `speed` without regard to vehicles."""
    speed: float = WALKING
    """Speed at which the pedestrian walks unless something holds the pedestrian up [m/s]."""
    lawful: bool = True
    """Whether the pedestrian waits for WALK at a pedestrian light."""
    people: int = 1
    """Number of pedestrians who walk behind each other."""
    kerb: bool = False
    """Whether the pedestrian looks at the kerb before going, so that the pedestrian starts before the kerb."""
    parked: bool = False
    """Whether a parked vehicle hides the pedestrian from vehicles that come to the junction."""

    def obeys(self, light: Colour) -> bool:
        """Return whether the pedestrian does not start to cross while the pedestrian light has a colour."""
        return self.lawful and light in (Colour.YELLOW, Colour.RED)

    def pace(self) -> Pace:
        """Return the pace of a new pedestrian, who waits at the kerb for WALK if the behaviour is lawful."""
        walk = self.make() if self.make else lambda _: self.speed

        def obey(sight: Sight) -> float:
            at_kerb = -KERB <= sight.station <= 0.0
            return 0.0 if at_kerb and self.obeys(sight.light) else walk(sight)

        return obey


def _yields(sight: Sight) -> float:
    """Walk to the kerb, and go when every vehicle that comes is slow, or leaves time for the whole crossing."""
    needed = (sight.length - sight.station) / WALKING + _SPARE
    threat = any(v.speed >= _YIELDING and v.distance < v.speed * needed for v in sight.vehicles)
    return 0.0 if threat and -KERB <= sight.station <= 0.0 else WALKING


def _stops() -> Pace:
    until = math.inf

    def pace(sight: Sight) -> float:
        nonlocal until
        if sight.station < sight.length / 2:
            return WALKING
        until = min(until, sight.time + _PAUSE)
        return 0.0 if sight.time < until else WALKING

    return pace


def _returns() -> Pace:
    turned = False

    def pace(sight: Sight) -> float:
        nonlocal turned
        turned = turned or sight.station >= sight.length / 2
        return -WALKING if turned else WALKING

    return pace


def _waits(sight: Sight) -> float:
    """Walk to the kerb, and stand there."""
    return 0.0 if sight.station >= -KERB else WALKING


BEHAVIOURS = {
    "steady": Behaviour(),
    "yields": Behaviour(lambda: _yields, kerb=True),
    "darts": Behaviour(speed=RUNNING),
    "stops": Behaviour(_stops),
    "returns": Behaviour(_returns),
    "against": Behaviour(lawful=False),
    "group": Behaviour(people=3),
    "waits": Behaviour(lambda: _waits, kerb=True),
    "hidden": Behaviour(parked=True),
}
"""Behaviours by name.

``steady`` walks on without regard to vehicles. ``yields`` waits at the kerb until every vehicle has stopped or is far enough.
``darts`` runs onto the crosswalk. ``stops`` stands for 4 s in the middle of the crossing. ``returns`` turns back in the middle.
``against`` starts without regard to the pedestrian light. ``group`` are three pedestrians behind each other. ``waits`` stands at
the kerb and never goes. ``hidden`` walks steadily out from behind a parked vehicle.
"""


def behaviour(name: str) -> Behaviour:
    """Return the behaviour that has a name."""
    if name not in tuple(BEHAVIOURS):  # a wrong value need not be hashable
        raise ScenarioError(
            f"pedestrians have the behaviours {', '.join(BEHAVIOURS)}, got {name!r}{suggest(str(name), BEHAVIOURS)}"
        )
    return BEHAVIOURS[name]
