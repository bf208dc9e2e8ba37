"""The measurements of a run and the divergence of two runs, as values that reports hold; this module loads no numpy."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from pytest_rvads.support.wording import shown

APART = 6.0
"""Longest time between the arrivals of two vehicles that meet at a junction [s]."""


_Number = Annotated[int, msgspec.Meta(ge=0)]
_Difference = Annotated[float, msgspec.Meta(ge=-APART, le=APART)]


class VehicleKpis(msgspec.Struct, frozen=True):
    """Indicators of one vehicle."""

    agent: str
    arrival: float | None = None
    """Time from the start of the run to the first arrival of the vehicle at its line [s]; None without an arrival."""
    waiting: float = 0.0
    """Time that the vehicle spent at its entrance [s]."""
    delay: float | None = None
    """Time from the first state of the vehicle to the exit vertex, minus the time that this way takes at the speed limit [s].

    None if the vehicle does not reach the exit vertex.
    """
    deceleration: float | None = None
    """Hardest braking, averaged over a tenth of a second, before the vehicle first touched another vehicle [m/s^2]."""
    jerk: float | None = None
    """Largest change of acceleration, over a tenth of a second, before the vehicle first touched another vehicle [m/s^3]."""


class PairKpis(msgspec.Struct, frozen=True):
    """Indicators of two vehicles."""

    agents: tuple[str, str]
    ttc: float | None = None
    """Shortest time to collision over all states, if both vehicles kept the speed and heading of the state [s].

    0 if the bodies touch; None if the vehicles are never on a collision course.
    """
    pet: float | None = None
    """Post-encroachment time: from the moment at which the rear of one vehicle leaves the stretch where the movements conflict to
    the moment at which the other vehicle enters the stretch [s].

    The time is negative if both vehicles are in the stretch at the same time. A vehicle that is still in the stretch at the end
    of the run counts as leaving at that time. None if the ways do not conflict, or if a vehicle never reached the stretch.
    """


class Kpis(msgspec.Struct, frozen=True):
    """Indicators of a run."""

    vehicles: tuple[VehicleKpis, ...] = ()
    """The indicators of single vehicles."""
    pairs: tuple[PairKpis, ...] = ()
    """The indicators of pairs of vehicles."""
    unavailable: tuple[str, ...] = ()
    """Names of the indicators that the run can't give; any other indicator that is None had nothing to measure."""
    ttc: float | None = None
    """The shortest time to collision of all pairs [s]."""
    pet: float | None = None
    """The shortest post-encroachment time of all pairs [s]."""

    def record(self) -> dict[str, Any]:
        """Return the indicators as builtins that JSON can hold."""
        content: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        return content

    def _repr_html_(self) -> str:
        return shown(self)


class ArrivalDifferences(msgspec.Struct, frozen=True):
    """Differences between the arrivals of vehicles under test and of other vehicles with conflicting movements."""

    symmetry: Annotated[int, msgspec.Meta(ge=1)]
    """Least number of arms by which a rotation keeps lanes, movements and signs of the junction; the number of all arms if only
    the full turn keeps them."""
    pairs: Annotated[int, msgspec.Meta(ge=0)]
    """Number of ordered pairs of conflicting movements of the junction; pairs of movements that a rotation by such a number of
    arms maps onto each other count as one pair."""
    tried: tuple[tuple[_Number, _Number, _Difference], ...] = ()
    """Per pair of a vehicle under test and another vehicle that arrived within `APART` of it: their numbers among the agents of
    the run, and the arrival of the other vehicle minus the arrival of the vehicle under test, rounded to 0.01 s [s]."""


class Divergence(msgspec.Struct, frozen=True, omit_defaults=True):
    """The first difference between two runs."""

    what: str
    """What differs: a field and a vehicle, such as ``speed of a1``, or another property, such as ``length``."""
    one: str = ""
    """Value of the field in the first run."""
    other: str = ""
    """Value of the field in the other run."""
    tick: int | None = None
    """Index of the first state that differs; None if no state differs."""
    time: float | None = None
    """Time of the first state that differs [s]; None if no state differs."""
    text: str = ""
    """The difference as a sentence, if `one` and `other` do not show the difference."""

    def __str__(self) -> str:
        if self.text:
            return self.text
        at = "" if self.time is None else f"t={self.time:.2f} s (tick {self.tick}): "
        return f"{at}{self.what} is {self.one} in one run, {self.other} in the other"
