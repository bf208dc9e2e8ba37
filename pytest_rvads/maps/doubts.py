"""Doubts: what the reader repaired or could not be sure of, as typed records instead of log lines."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = ["Doubt", "MapWarning"]


class Doubt(StrEnum):
    """Kinds of warnings about a map."""

    GAP = "gap"
    """Two linked lanes, or two pieces of a reference line, do not meet; overlaps were cut, steps to the side blended."""
    LENGTH = "length"
    """The drawn reference line is not as long as the road says, or there is none and the road was left out."""
    KINK = "kink"
    """A reference line bends sharply; the lane on the inner side would run backwards there and was cut."""
    ORIENTATION = "orientation"
    """The orientation of a signal contradicts the traffic it is for, and was ignored."""
    TABLE = "table"
    """The connection table of a junction and the links of its roads disagree, or junctions were read as one cluster."""
    LINK = "link"
    """A link names something that does not exist or the wrong end of a road, or was completed from the geometry."""
    SIGNAL = "signal"
    """A signal is broken or could not be attached to an entrance, or a reference names no signal."""
    LANE = "lane"
    """A lane section has two lanes with the same id; the lane that is not for driving was left out."""
    RIGHT_OF = "right_of"
    """No pair of entrances is right-of another: a Y junction, where the priority rules say nothing."""
    ORDER = "order"
    """The movements of an entrance do not follow the cyclic order of the exits."""
    BEND = "bend"
    """No path of its rear axle keeps a usual car in its lane on a movement: the car cuts the corner or swings out."""
    ROOM = "room"
    """A car that stands at its line leaves no room for the body of a car on another movement."""
    SIDE = "side"
    """A road does not say on which side traffic keeps, or says the wrong one; what the lanes need was taken."""
    SPEED = "speed"
    """A speed limit can't be read and was ignored."""
    UNITS = "units"
    """The header states a length unit; the standard's metres were taken."""


@dataclass(frozen=True, slots=True)
class MapWarning:
    """One repair or doubt."""

    kind: Doubt
    message: str
    """One sentence."""
    road: str | None = None
    """Id of the road it is about."""
    junction: str | None = None
    """Id of the junction it is about."""

    def record(self) -> dict[str, str | None]:
        """Return the fields as builtins."""
        return {"kind": self.kind.value, "message": self.message, "road": self.road, "junction": self.junction}
