"""What commands that read tracks have in common: which point of a vehicle they tell, where, and how exactly."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pytest_rvads.errors import RunError

if TYPE_CHECKING:
    from pytest_rvads.satellites.tracks.intake import Intake
    from pytest_rvads.satellites.tracks.logformats import Point

__all__ = ["INTAKE", "add_intake", "intake_of"]

INTAKE = ("point", "size", "offset", "position_accuracy", "speed_accuracy", "speed_limit")
"""Names of the options, as they are parsed."""


def add_intake(parser: argparse._ActionsContainer) -> None:
    """Add the options that an `Intake` is made from."""
    parser.add_argument("--point", metavar="POINT", help="what x and y are of: center of the box, front (bumper) or rear_axle")
    parser.add_argument("--size", metavar="L,W", help="length and width of vehicles whose size the log has not [m]")
    parser.add_argument("--offset", metavar="X,Y", help="added to every position [m]; write --offset=-5,2")
    parser.add_argument(
        "--position-accuracy", type=float, metavar="M", help="standard deviation of a coordinate [m] (default: estimated)"
    )
    parser.add_argument("--speed-accuracy", type=float, metavar="M/S", help="standard deviation of a speed [m/s]")
    parser.add_argument("--speed-limit", type=float, metavar="M/S", help="speed limit at the junction [m/s]")


def intake_of(options: argparse.Namespace, usual: Point) -> Intake:
    """Return what the options say; `usual` is the point where they say none.

    Raises:
        RunError: a value that can't be.
    """
    from pytest_rvads.satellites.tracks.intake import Intake

    return Intake(
        options.point or usual,
        _numbers(options.size, "--size L,W"),
        _numbers(options.offset, "--offset=X,Y") or (0.0, 0.0),
        options.position_accuracy,
        options.speed_accuracy,
        options.speed_limit,
    )


def _numbers(text: str | None, wanted: str) -> tuple[float, float] | None:
    """Return two numbers of an option, None where it was not given."""
    if text is None:
        return None
    try:
        one, two = map(float, text.split(","))
    except ValueError:
        raise RunError(f"{wanted} takes two numbers in metres, got {text!r:.60}") from None
    return one, two
