"""Configurations (distances and speeds per entrance): the paper's A to J, staggered starts, or distances and speeds of a user.

In a staggered start, the other vehicles arrive at their lines earlier or later than the vehicle under test. A configuration keeps
to the braking envelope: a vehicle that starts d metres before the stopping line is no faster than v(d)max, because a faster
vehicle would break rules by its speed alone (paper, section 5.3).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.scenarios.classes import rotate
from pytest_rvads.support.errors import ScenarioError, suggest

Envelope = Callable[[float], float | None]
"""v(d)max: maps the distance to the stopping line [m] to the greatest safe speed [m/s]; None if even 0 m/s is unsafe."""

PAPER = {JunctionControl.STOP: "ABCDE", JunctionControl.LIGHTS: "FGHIJ"}
"""The paper's configurations by control. Configurations A and F reveal a controller that drives off before it looks."""

ARRIVALS = "arrivals"
"""Name of the default grid of tests with a subject: all vehicles 20 m before their lines, and staggered starts."""

_NEAR, _CLOSE, _FAR, _FAST = 0.01, 0.3, 20.0, 10.0
_STAGGERED_SPEED = 8.0
"""Speed of every vehicle of a staggered configuration [m/s]; below the speed limit."""
_NEAREST = 10.0
"""Least distance of a vehicle of a staggered configuration from its line [m]; v(d)max is 8.66 m/s at this distance."""
_AT_STOPS, _ELSEWHERE = (36, "S21 S26 S31 S46 S51 S56"), (20, "S31 S42 S53 S64 S75")
"""Distance of the subject [m], and the labels of the staggered configurations: S and the distance of the other vehicles [m].

At an all-way stop, where the order of arrival decides, the other vehicles arrive 1.5, 1 and 0.5 s earlier and 1, 1.5 and 2 s
later than the subject. Elsewhere they arrive 1 to 5 s later.
"""
_STAGGERED_LABEL = re.compile(r"S\d{1,3}(_\d{1,3})*")


@dataclass(frozen=True, slots=True)
class Configuration:
    """Distances and speeds of a scenario, per entrance before rotation."""

    label: str
    distances: tuple[float, ...]
    """Distances from the reference points to the stopping lines [m]."""
    speeds: tuple[float, ...]
    """Speeds [m/s]."""
    staggered: bool = False
    """Whether the distances and speeds are counted from the entrance of the subject, counter-clockwise, instead of entrance 0."""

    @property
    def room(self) -> float:
        """Least length of an approach that the configuration needs [m]."""
        return _NEAREST if self.staggered else max(self.distances)

    def around(self, seat: int, rooms: Sequence[float]) -> Configuration:
        """Return a staggered configuration per entrance, around a subject; other configurations are returned unchanged.

        On an approach that is too short for its vehicle, the vehicle starts as far from the line as the approach allows. If the
        subject starts nearer for this reason, the other vehicles start nearer by the same distance, but at least `_NEAREST`
        before their lines. The rooms are the lengths of the approaches before rotation [m].
        """
        if not self.staggered:
            return self
        most = [max(float(math.floor(room)), _NEAREST) for room in rooms]
        nearer = max(self.distances[0] - most[seat], 0.0)
        starts = (max(distance - nearer, _NEAREST) for distance in rotate(self.distances, seat))
        return Configuration(self.label, tuple(map(min, zip(starts, most, strict=True))), self.speeds)


def configuration(label: str, entrances: int, control: JunctionControl = JunctionControl.STOP) -> Configuration:
    """Return the configuration called `label` for `entrances` entrances of a junction with a given control.

    The label is a letter of the paper, A to J; or for a staggered configuration ``S`` and the distance of the other vehicles [m],
    or a distance per entrance, counter-clockwise from the subject: ``S26_56_56``.
    """
    if not _STAGGERED_LABEL.fullmatch(label):
        first = (entrances + 1) // 2
        near, close, far = (_NEAR,) * entrances, (_CLOSE,) * entrances, (_FAR,) * entrances
        distances = {
            **dict.fromkeys("AF", near),
            **dict.fromkeys("BG", close),
            **dict.fromkeys("CHDI", far),
            "E": (_CLOSE,) * first + (_FAR,) * (entrances - first),
            "J": tuple(_CLOSE if i % 2 else _FAR for i in range(entrances)),
        }
        if label not in distances:
            hint = suggest(label.upper(), distances)
            raise ScenarioError(
                f"unknown configuration {label!r}: the paper's are A..J, staggered ones are such as S21, or give distances= and "
                f"speeds={hint}"
            )
        return Configuration(label, distances[label], (_FAST if label in "DI" else 0.0,) * entrances)
    of_subject, _ = _AT_STOPS if control is JunctionControl.STOP else _ELSEWHERE
    of_traffic = [float(number) for number in label[1:].split("_")]
    of_traffic *= entrances - 1 if len(of_traffic) == 1 else 1
    if len(of_traffic) != entrances - 1:
        raise ScenarioError(f"configuration {label!r} is for {len(of_traffic) + 1} entrances, the junction has {entrances}")
    return Configuration(label, (float(of_subject), *of_traffic), (_STAGGERED_SPEED,) * entrances, staggered=True)


def grid(names: str | Iterable[str], entrances: int, control: JunctionControl) -> tuple[Configuration, ...]:
    """Return the configurations of a named grid, or of several.

    A name is ``"paper"`` for the paper's five configurations of `control` (those of stops, if the control is neither stop nor
    lights), ``"staggered"`` for all staggered configurations, ``"arrivals"`` for the default of tests with a subject, the label
    of a staggered configuration, or a string of letters.
    """
    letters, stop = PAPER.get(control, PAPER[JunctionControl.STOP]), control is JunctionControl.STOP
    _, staggered = _AT_STOPS if stop else _ELSEWHERE
    # If several vehicles arrive together before the subject, the vehicle at the subject's left goes first, and a subject that
    # ignores that vehicle is not detected. So in one configuration only the vehicle at the right is early, and in another only
    # the vehicle at the left.
    late = ["56"] * (entrances - 2)
    at_stops = ["S21", "S46", "_".join(("S26", *late)), f"S{'_'.join((*late, '26'))}"]
    named: dict[str, Sequence[str]] = {
        "paper": letters,
        "staggered": staggered.split(),
        ARRIVALS: [letters[2], *(at_stops if stop else staggered.split()[:4])],
    }
    labels: list[str] = []
    for name in [names] if isinstance(names, str) else names:
        labels += named.get(name, [name] if _STAGGERED_LABEL.fullmatch(name) else name)
    if not labels:
        raise ScenarioError("a grid needs at least one configuration, such as 'paper', 'D' or ('C', 'D')")
    return tuple(configuration(label, entrances, control) for label in dict.fromkeys(labels))


Axis = float | tuple[float, ...] | list[float | tuple[float, ...]]


def explicit(distances: Axis, speeds: Axis, entrances: int) -> tuple[Configuration, ...]:
    """Return the product of explicit distances [m] and speeds [m/s].

    Either is a number for all entrances, a tuple with one number per entrance, or a list of such numbers and tuples.
    """
    axes = []
    for name, axis in (("distances", plain(distances)), ("speeds", plain(speeds))):
        entries: list[float | tuple[float, ...]] = axis if isinstance(axis, list) else [axis]
        if not entries:
            raise ScenarioError(f"{name} is an empty list: give at least one value")
        axes.append([per_entrance(name, entry, entrances) for entry in entries])
    return tuple(Configuration(explicit_label(d, v), d, v) for d, v in product(*axes))


def explicit_label(distances: Sequence[float], speeds: Sequence[float]) -> str:
    """Return the label of explicit values: ``d20.00_00.30v00.00``; a single value if all values are equal."""

    def text(values: Sequence[float]) -> str:
        return "_".join(f"{v:05.2f}" for v in (values[:1] if len(set(values)) == 1 else values))

    return f"d{text(distances)}v{text(speeds)}"


def outside(point: Configuration, envelope: Envelope) -> tuple[float, float] | None:
    """Return the first (distance, speed) of configuration `point` that is beyond the braking envelope, or None."""
    for distance, speed in zip(point.distances, point.speeds, strict=True):
        limit = envelope(distance) if speed > 0 else 0.0
        if limit is None or speed > limit:
            return distance, speed
    return None


def probe(point: Configuration, envelope: Envelope) -> str:
    """Return a sentence if the start `point` deliberately provokes a wrong reaction of the driver; an empty text if not."""
    beyond = outside(point, envelope)
    if beyond is not None:
        distance, speed = beyond
        limit = envelope(distance) or 0.0
        return f"a deliberate probe: at {speed:g} m/s nobody stops within {distance:g} m, v(d)max is {limit:.2f} m/s"
    if min(point.distances) <= _NEAR:
        return f"a deliberate probe: {_NEAR:g} m before the line a vehicle that drives off before looking crosses the line"
    return ""


def per_entrance(name: str, value: float | Sequence[float], entrances: int) -> tuple[float, ...]:
    """Return `value` as one finite number of 0 or more per entrance."""
    value = plain(value)
    if isinstance(value, str) or not isinstance(value, int | float | Sequence):
        raise ScenarioError(f"{name} takes numbers, got {value!r}")
    values = (value,) * entrances if isinstance(value, int | float) else tuple(map(plain, value))
    if len(values) != entrances:
        raise ScenarioError(f"{name} needs one value, or one per entrance ({entrances}), got {len(values)}: {values!r}")
    for number in values:
        if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number < float("inf"):
            raise ScenarioError(f"{name} must be 0 or more and finite, got {number!r}")
    return tuple(float(v) for v in values)


def plain(value: Any) -> Any:
    """Return an array or number of numpy as builtins, any other value unchanged."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
