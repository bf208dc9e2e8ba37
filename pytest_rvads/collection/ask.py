"""What a test asks for: the arguments of ``@rvads.scenario``, checked when it is written and resolved at collection."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any

from pytest_rvads.collection.cells import DEFAULT
from pytest_rvads.collection.extensions import Extensions
from pytest_rvads.collection.misuse import several
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.errors import ScenarioError, suggest
from pytest_rvads.junctions.builtin import LAYOUTS
from pytest_rvads.junctions.finder import find
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.logic.rules.book import claim, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.options import Options
from pytest_rvads.scenarios.classes import parse
from pytest_rvads.scenarios.configurations import Configuration, explicit, grid, outside, per_entrance, plain
from pytest_rvads.scenarios.orbits import OCCUPANCIES
from pytest_rvads.scenarios.scenario import check_followers, check_numbers
from pytest_rvads.scenarios.selection import CHOOSING, COVERS, Selection
from pytest_rvads.scenarios.senses import IDEAL, Senses

__all__ = ["Ask", "judged_at"]

Values = tuple[float | tuple[float, ...], ...]
"""One after the other, each for all entrances or per entrance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ask:
    """What ``@rvads.scenario`` asks for, see there; None leaves it to the session."""

    place: str
    """File and line of the mark."""
    junction: str
    map: str | os.PathLike[str] | None
    classes: tuple[int, ...] | None
    scenarios: tuple[str, ...] | None
    cover: str | None
    occupancy: str
    followers: tuple[int, ...]
    grid: tuple[str, ...] | None
    distances: Values | None
    speeds: Values | None
    probe: bool
    rules: tuple[str | Rule, ...] | None
    subject: int | str | None
    traffic: tuple[Policy | None, ...]
    """None alone without a subject."""
    senses: tuple[Senses, ...]
    duration: float | None
    aggression: int
    wait: float
    requirement: tuple[str, ...]

    @classmethod
    def of(cls, place: str, asked: Mapping[str, Any]) -> Ask:
        """Check arguments as far as they can be without junction and session.

        Raises:
            ScenarioError: an argument of a wrong type, an empty list, or arguments that exclude each other.
        """
        checked = dict(asked)
        for wrong in checked.pop("misspelt"):
            raise ScenarioError(f"@rvads.scenario takes {', '.join(checked)}, got {wrong!r}{suggest(wrong, checked)}")
        _refuse(asked)
        check_numbers(asked["duration"], asked["aggression"], asked["wait"])
        for name, (kind, what) in _SEVERAL.items():
            if not (name == "senses" and isinstance(asked[name], Mapping)):
                checked[name] = several(name, asked[name], kind, what)
        checked |= {
            "distances": _values("distances", asked["distances"]),
            "speeds": _values("speeds", asked["speeds"]),
            "traffic": (None,) if asked["subject"] is None else _policies(asked["traffic"]),
            "senses": Senses.grid(asked["senses"]) if isinstance(asked["senses"], Mapping) else checked["senses"] or (IDEAL,),
            "requirement": checked["requirement"] or (),
            "followers": checked["followers"] or (0,),
        }
        for count in checked["followers"]:
            check_followers(count)
        return cls(place=place, **checked)

    def resolve(
        self, folder: Path, options: Options, added: Extensions, watch: Callable[..., Iterable[Configuration]]
    ) -> Selection:
        """Return the scenarios to run, of a test in `folder`; `watch` yields configurations and tells how many are done.

        Raises:
            RvadsError: no such junction, or one that does not have what is asked for.
        """
        place = find(*self._source(folder, options.map, added))
        configurations, left_out = self._configurations(place, options, added.grids, watch)
        entrances, codes = len(place.entrances), []
        for text in self.scenarios or ():
            codes.append(code := parse(text))
            if len(code) != entrances:
                raise ScenarioError(f"scenario {text!r} names {len(code)} entrances, junction {place.name!r} has {entrances}")
        cover = self.cover or options.cover
        if cover in CHOOSING and (self.classes or self.scenarios):  # that of the session is for tests that name none
            cover = "class"
        return Selection(
            place,
            configurations,
            cover,
            scenarios=tuple(codes) or None,
            left_out=left_out,
            **{name: getattr(self, name) for name in _SAME},
        )

    def judged_by(self, place: Junction) -> tuple[Rule, ...]:
        """Return the rules to judge runs at a junction by.

        Raises:
            RvadsError: no such rule, none about this kind of junction, or one of a name that means another one elsewhere.
        """
        return judged_at(self.rules or ("paper" if self.subject is None else "road",), place)

    def _source(self, folder: Path, default: str | None, added: Extensions) -> tuple[str, str | None]:
        """Return junction and map as the finder takes them."""
        if self.map is not None:
            beside = folder / self.map
            return self.junction, str((beside if beside.exists() else Path(self.map)).resolve())
        if self.junction in added.junctions:
            file, name = added.junctions[self.junction]
            return name, file
        return self.junction, None if self.junction in LAYOUTS else default

    def _configurations(
        self,
        place: Junction,
        options: Options,
        grids: Mapping[str, tuple[Any, Any]],
        watch: Callable[..., Iterable[Configuration]],
    ) -> tuple[tuple[Configuration, ...], int]:
        """Return the configurations to run, and how many were left out because nobody could stop there."""
        ways, names = len(place.entrances), self.grid or (options.grid,)
        axes = [grids[name] for name in names if name in grids]
        letters = [name for name in names if name not in grids]
        if self.distances:
            axes, letters = [(list(self.distances), list(self.speeds or (0.0,)))], []
        paper = grid(letters, ways, place.control) if letters else ()
        own = [configuration for distances, speeds in axes for configuration in explicit(distances, speeds, ways)]
        kept = own if self.probe or not own else self._stopping(own, watch)
        if own and not kept and not paper:
            asked = f"distances={axes[0][0]!r}, speeds={axes[0][1]!r}" if self.distances else f"grid={names!r}"
            raise ScenarioError(
                f"every point of {asked} is too fast to stop before the line "
                "(`rvads braking` lists v(d)max): lower the speeds, or say probe=True to run them all the same"
            )
        return tuple(dict.fromkeys((*paper, *kept))), len(own) - len(kept)

    def _stopping(self, points: Sequence[Configuration], watch: Callable[..., Iterable[Configuration]]) -> list[Configuration]:
        """Return the points from which vehicles can stop, as the simulator of the session has it."""
        from pytest_rvads.simulators.simulator import vmax  # most tests need no physics before they run

        return [point for point in watch(points) if not outside(point, lambda d: vmax(d, self.aggression))]


def judged_at(names: Sequence[str | Rule], place: Junction) -> tuple[Rule, ...]:
    """Return those of the rules and rulebooks named that runs at a junction are judged by.

    Raises:
        RvadsError: no such rule, none about this kind of junction, or one of a name that means another one elsewhere.
    """
    rules = rules_for(names, place)
    if not rules:
        raise ScenarioError(
            f"no rule of {', '.join(map(repr, names))} is about a junction with control {place.control.value!r} like "
            f"{place.name!r}: name rules outright, `rvads rules` lists them"
        )
    for rule in rules:
        claim(rule)
    return rules


_SAME = ("occupancy", "classes", "subject", "followers", "senses", "duration", "aggression", "wait")
"""The arguments that a selection takes as they are."""
_SEVERAL: dict[str, tuple[Any, str]] = {
    "classes": (Integral, "class numbers"),
    "scenarios": (str, "direction strings such as '1133'"),
    "grid": (str, "letters of configurations or names of grids"),
    "rules": ((str, Rule), "rules or names of rules or rulebooks"),
    "followers": (Integral, "numbers of vehicles that queue behind each"),
    "senses": (Senses, "rvads.Senses(...) or a dict of their fields"),
    "requirement": (str, "identifiers of requirements"),
}
"""The arguments that take one value or several: of which type, and how to say it."""
_SINGLE: dict[str, tuple[Callable[[Any], bool], str]] = {
    "map": (lambda file: file is None or isinstance(file, str | os.PathLike), "the path of an OpenDRIVE file"),
    "cover": (lambda cover: cover in (None, *COVERS), f"one of {', '.join(COVERS)}"),
    "occupancy": (lambda occupancy: occupancy in OCCUPANCIES, f"one of {', '.join(OCCUPANCIES)}"),
    "probe": (lambda probe: isinstance(probe, bool), "True or False"),
    "subject": (lambda subject: subject in (None, "all") or type(subject) is int, "an entrance, counted from 0, or 'all'"),
}
"""The arguments that take one value: whether it is right, and how to say it."""


def _refuse(asked: Mapping[str, Any]) -> None:
    """Refuse wrong values of arguments that take one, and arguments that exclude each other."""
    if not isinstance(asked["junction"], str):
        got = asked["junction"]
        raise ScenarioError(f"write @rvads.scenario('stop4', ...) with the name of a junction in quotes, got {got!r}")
    for name, (right, expected) in _SINGLE.items():
        if not right(asked[name]):
            raise ScenarioError(f"{name} must be {expected}, got {asked[name]!r}")
    given = {name for name, value in asked.items() if value is not None}
    if given >= {"classes", "scenarios"}:
        raise ScenarioError("give classes= or scenarios=, not both: a scenario names its class")
    if given & {"classes", "scenarios"} and asked["cover"] in CHOOSING:
        raise ScenarioError(f"cover={asked['cover']!r} chooses scenarios itself: leave classes= and scenarios= out, or the cover")
    if given >= {"grid", "distances"} or given & {"speeds", "distances"} == {"speeds"}:
        raise ScenarioError("give either grid=, or distances= with speeds=")
    if given & {"traffic", "subject"} == {"traffic"}:
        raise ScenarioError("traffic= drives the vehicles beside a subject: say subject=0 or 'all', or leave traffic= out")


def _values(name: str, axis: Any) -> Values | None:
    """Return distances or speeds, one after the other; how many entrances there are is not known yet."""
    axis = plain(axis)
    entries = list(map(plain, axis)) if isinstance(axis, list) else [] if axis is None else [axis]
    if axis == []:
        raise ScenarioError(f"{name} is an empty list: give at least one value")
    for entry in entries:
        per_entrance(name, entry, len(entry) or 1 if isinstance(entry, Sequence) else 1)
    return tuple(tuple(entry) if isinstance(entry, Sequence) else entry for entry in entries) or None


def _policies(traffic: Any) -> tuple[Policy, ...]:
    """Return the traffic policies to run among, one after the other."""
    several = isinstance(traffic, Iterable) and not isinstance(traffic, str) and not callable(traffic)
    named = tuple(traffic) if several else (DEFAULT if traffic is None else traffic,)
    if not named:
        raise ScenarioError("traffic is empty: name a policy or an autopilot, or leave it out")
    return tuple(map(Policy.of, named))
