"""The measurements of a run and the divergence of two runs, as values that reports hold; this module loads no numpy."""

from __future__ import annotations

from typing import Any

import msgspec

__all__ = ["Divergence", "Kpis", "PairKpis", "VehicleKpis"]


class VehicleKpis(msgspec.Struct, frozen=True):
    """Indicators of one vehicle."""

    agent: str
    arrival: float | None = None
    """When it first arrived at its line, see `arrivals`, since the run began [s]; None if it never did."""
    waiting: float = 0.0
    """Time at its entrance [s]."""
    delay: float | None = None
    """Time to its exit vertex beyond what driving there at the speed limit takes [s]; None if it never got there."""
    deceleration: float | None = None
    """Hardest braking, over a tenth of a second, before the vehicle first touched another: an impact is no braking [m/s^2]."""
    jerk: float | None = None
    """Largest change of acceleration, over a tenth of a second, before the vehicle first touched another [m/s^3]."""


class PairKpis(msgspec.Struct, frozen=True):
    """Indicators of two vehicles."""

    agents: tuple[str, str]
    ttc: float | None = None
    """Shortest time to collision, were both to keep speed and heading [s]; 0 where bodies touch; None if they never are
    on a collision course."""
    pet: float | None = None
    """Time from when the rear of one leaves the stretch where their movements conflict to when the other enters it [s];
    negative where both are in it, at the end of the run at most; None if their ways do not conflict, or if a vehicle never
    reached the conflict."""


class Kpis(msgspec.Struct, frozen=True):
    """Indicators of a run."""

    vehicles: tuple[VehicleKpis, ...] = ()
    pairs: tuple[PairKpis, ...] = ()
    unavailable: tuple[str, ...] = ()
    """Indicators that the run does not record enough for; an indicator that is None and not named here had nothing to measure."""
    ttc: float | None = None
    """The shortest time to collision of all pairs [s]."""
    pet: float | None = None
    """The shortest post-encroachment time of all pairs [s]."""

    def record(self) -> dict[str, Any]:
        """Return builtins that JSON has too."""
        content: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        return content


class Divergence(msgspec.Struct, frozen=True, omit_defaults=True):
    """The first difference between two runs."""

    what: str
    """Field and vehicle, such as ``speed of a1``; or what else the runs do not share."""
    one: str = ""
    """Value of the field in the first run."""
    other: str = ""
    """Value of the field in the other run."""
    tick: int | None = None
    """Index of the first state that differs; None if no state differs."""
    time: float | None = None
    """Time of this state [s]."""
    text: str = ""
    """The difference as a sentence, if the values do not show it."""

    def __str__(self) -> str:
        if self.text:
            return self.text
        at = "" if self.time is None else f"t={self.time:.2f} s (tick {self.tick}): "
        return f"{at}{self.what} is {self.one} in one run, {self.other} in the other"
