"""The arguments of ``@rvads.scenario``: checked when the mark is evaluated, resolved when its test is collected.

An `Ask` holds the file and line of its mark, so that errors which are found only at collection name this line, too.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pytest_rvads.drivers.traffic import DEFAULT, Policy
from pytest_rvads.geometry.finder import EVERY, Kinds, choose_among, some
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import NAMES
from pytest_rvads.logic.rules.book import claim, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.scenarios.classes import OCCUPANCIES, parse
from pytest_rvads.scenarios.configurations import ARRIVALS, Configuration, explicit, grid, outside, per_entrance, plain
from pytest_rvads.scenarios.pedestrians import walks_of
from pytest_rvads.scenarios.scenario import check_followers, check_numbers
from pytest_rvads.scenarios.selection import CHOOSING, COVERS, Selection
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.session.collection.cells import NoRoom, Resolved, Selected
from pytest_rvads.session.collection.extensions import Extensions
from pytest_rvads.session.collection.misuse import beside, refuse_unknown, several
from pytest_rvads.session.options import Options
from pytest_rvads.support.errors import ScenarioError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pytest_rvads.drivers.interface import Factory
    from pytest_rvads.scenarios.pedestrians import Pedestrian
    from pytest_rvads.simulators.simulator import Simulator

_SEVERAL: dict[str, tuple[Any, str]] = {
    "junction": (str, "names, ids or types of junctions"),
    "classes": (Integral, "class numbers"),
    "scenarios": (str, "direction strings such as '1133'"),
    "grid": (str, "letters of configurations or names of grids"),
    "rules": ((str, Rule), "rules or names of rules or rulebooks"),
    "followers": (Integral, "numbers of vehicles that queue behind each"),
    "senses": (Senses, "rvads.Senses(...) or a dict of their fields"),
    "requirement": (str, "identifiers of requirements"),
}
"""Per argument that takes one value or several values: the type of a value, and its name in messages."""
_SINGLE: dict[str, tuple[Callable[[Any], bool], str]] = {
    "limit": (lambda most: most is None or (type(most) is int and most > 0), "a whole number of junctions, 1 or more"),
    "map": (lambda file: file is None or isinstance(file, str | os.PathLike), "the path of a map file"),
    "cover": (lambda cover: cover in (None, *COVERS), f"one of {', '.join(COVERS)}"),
    "occupancy": (lambda occupancy: occupancy in OCCUPANCIES, f"one of {', '.join(OCCUPANCIES)}"),
    "probe": (lambda probe: isinstance(probe, bool), "True or False"),
    "subject": (lambda subject: subject in (None, "all") or type(subject) is int, "an entrance, counted from 0, or 'all'"),
}
"""Per argument that takes one value: a test of the value, and the expected value in words."""


@dataclass(frozen=True, slots=True)
class Ask:
    """The arguments of a mark ``@rvads.scenario``, which has these parameters; None stands for the default of the session.

    The types are those of what a test may write. `Ask.of` checks the arguments, and makes tuples or lists of what can be several
    values.
    """

    place: str
    """File and line of the mark; no argument of the mark."""
    junction: str | Iterable[str] | None = None
    _: KW_ONLY
    map: str | None = None
    junctions: Mapping[str, Any] | None = None
    limit: int | None = None
    classes: int | Iterable[int] | None = None
    scenarios: str | Iterable[str] | None = None
    cover: str | None = None
    occupancy: str = "arms"
    followers: int | Iterable[int] | None = None
    grid: str | Iterable[str] | None = None
    distances: float | Sequence[Any] | NDArray[Any] | None = None
    speeds: float | Sequence[Any] | NDArray[Any] | None = None
    probe: bool = False
    rules: str | Rule | Iterable[str | Rule] | None = None
    subject: int | str | None = None
    traffic: str | Factory | Iterable[str | Factory] | None = None
    pedestrians: str | Pedestrian | Mapping[str, Any] | Iterable[str | Pedestrian | Mapping[str, Any]] | None = None
    senses: Senses | Iterable[Senses] | Mapping[str, Any] | None = None
    duration: float | None = None
    aggression: int = 1
    wait: float = 1.5
    requirement: str | Iterable[str] | None = None

    @classmethod
    def of(cls, place: str, given: Mapping[str, Any]) -> Ask:
        """Check the arguments of a mark as far as possible without the junction and the options of the session."""
        values: dict[str, Any] = {argument.name: argument.default for argument in fields(cls) if argument.name != "place"}
        refuse_unknown("@rvads.scenario takes", given, values)
        values |= given
        junction = values["junction"]
        if junction is None and values["junctions"] is None:
            raise ScenarioError(
                f"name a junction, several junctions, or {EVERY!r} for all junctions of a map, or give junctions="
            )
        if not isinstance(junction, str | Iterable | None):
            raise ScenarioError(f"write @rvads.scenario('stop4', ...) with the name of a junction in quotes, got {junction!r}")
        for name, (fits, expected) in _SINGLE.items():
            if not fits(values[name]):
                raise ScenarioError(f"{name} must be {expected}, got {values[name]!r}")
        named = {name for name, value in values.items() if value is not None}
        if named >= {"classes", "scenarios"}:
            raise ScenarioError("give classes= or scenarios=, not both: a scenario names its class")
        if named & {"classes", "scenarios"} and values["cover"] in CHOOSING:
            cover = values["cover"]
            raise ScenarioError(f"cover={cover!r} chooses scenarios itself: leave classes= and scenarios= out, or the cover")
        if named >= {"grid", "distances"} or named & {"speeds", "distances"} == {"speeds"}:
            raise ScenarioError("give either grid=, or distances= with speeds=")
        if named & {"traffic", "subject"} == {"traffic"}:
            raise ScenarioError("traffic= drives the vehicles beside a subject: say subject=0 or 'all', or leave traffic= out")
        check_numbers(values["duration"], values["aggression"], values["wait"])
        if isinstance(values["senses"], Mapping):
            values["senses"] = Senses.grid(values["senses"])
        values |= {name: one_or_several(name, values[name]) for name in _SEVERAL}
        values |= {
            "junction": values["junction"] or (EVERY,),
            "junctions": None if values["junctions"] is None else Kinds.of(values["junctions"]),
            "distances": _values_of("distances", values["distances"]),
            "speeds": _values_of("speeds", values["speeds"]),
            "pedestrians": walks_of(values["pedestrians"]),
            "traffic": (None,) if values["subject"] is None else _policies_of(values["traffic"]),
            "senses": values["senses"] or (IDEAL,),
            "requirement": values["requirement"] or (),
            "followers": values["followers"] or (0,),
        }
        for count in values["followers"]:
            check_followers(count)
        return cls(place, **values)

    def resolve(
        self,
        folder: Path,
        options: Options,
        added: Extensions,
        progress: Callable[..., Iterable[Configuration]],
        takes_rule: bool,
        simulator: Simulator | None,
    ) -> Selected:
        """Return the runs and rules that the mark selects at each junction; starts that `simulator` can't stop are left out.

        `folder` is that of the test, `added` is what hooks of users add, and `progress` yields points and shows the progress.
        """
        sources: list[tuple[str, str | None]] = []  # names of junctions and paths of map files, the arguments of `find`
        for name in self.junction or ():
            if self.map is not None:
                sources.append((name, str(Path(beside(folder, self.map)).resolve())))
            elif name in added.junctions:
                registered, id = added.junctions[name]
                sources.append((id, registered))
            else:
                sources.append((name, None if name in NAMES else options.map))
        choice = choose_among(sources, kinds=cast("Kinds | None", self.junctions))
        places = [place.limited(options.speed_limit) if options.speed_limit else place for place in choice.junctions]
        resolved: dict[Junction, Resolved] = {}
        errors: dict[Junction, ScenarioError] = {}
        while True:  # junctions that are left out do not count against the limit
            usable = [place for place in places if place not in errors]
            drawn = some(usable, self.limit, options.seed) if usable else ()
            unresolved = [place for place in drawn if place not in resolved]
            if not unresolved:
                break
            for place in unresolved:
                try:
                    resolved[place] = self._at(place, options, added.grids, progress, takes_rule, simulator)
                except ScenarioError as error:
                    errors[place] = error
        if not drawn:
            first, many = next(iter(errors.values())), len(places)
            raise first if many == 1 else ScenarioError(f"none of {many} junctions fits the mark, the first: {first}")
        left_out = [(refused.name, refused.reason) for refused in choice.refused]
        for place, misfit in errors.items():  # equal reasons count together, so the reason does not name the junction
            reason = str(misfit).replace(f"junction {place.name!r}", "the junction").replace(f" like {place.name!r}", "")
            no_room = "no scenario has room for its vehicles where they would start"
            left_out.append((place.name, no_room if isinstance(misfit, NoRoom) else reason))
        return Selected(tuple(resolved[place] for place in drawn), tuple(left_out), len(usable) - len(drawn))

    def _at(
        self,
        place: Junction,
        options: Options,
        grids: Mapping[str, tuple[Any, Any]],
        progress: Callable[..., Iterable[Configuration]],
        takes_rule: bool,
        simulator: Simulator | None,
    ) -> Resolved:
        """Return the runs and rules that the mark selects at a junction."""
        place = place.walked if self.pedestrians else place
        entrances = len(place.entrances)
        names = self.grid or (options.grid or ("paper" if self.subject is None else ARRIVALS),)
        axes = [grids[name] for name in names if name in grids]
        letters = [name for name in names if name not in grids]
        if self.distances:
            axes, letters = [(self.distances, self.speeds or [0.0])], []
        paper = grid(letters, entrances, place.control) if letters else ()
        points = [configuration for distances, speeds in axes for configuration in explicit(distances, speeds, entrances)]
        stopping = points
        if points and not self.probe:
            from pytest_rvads.simulators.simulator import vmax  # most tests need no physics before they run

            envelope = partial(vmax, aggression=self.aggression, simulator=simulator, limit=place.top_limit)
            stopping = [point for point in progress(points) if not outside(point, envelope)]
        if points and not stopping and not paper:
            asked = f"distances={axes[0][0]!r}, speeds={axes[0][1]!r}" if self.distances else f"grid={names!r}"
            raise ScenarioError(
                f"every point of {asked} is too fast to stop before the line "
                "(`rvads dynamics braking` lists v(d)max): lower the speeds, or say probe=True to run them all the same"
            )
        codes = []
        for text in self.scenarios or ():
            codes.append(code := parse(text))
            if len(code) != entrances:
                raise ScenarioError(f"scenario {text!r} names {len(code)} entrances, junction {place.name!r} has {entrances}")
        cover = self.cover or options.cover
        if cover in CHOOSING and (self.classes or self.scenarios):  # the cover of the session is for tests that name no scenarios
            cover = "class"
        selection = Selection(
            place,
            tuple(dict.fromkeys((*paper, *stopping))),
            cover,
            scenarios=tuple(codes) or None,
            left_out=len(points) - len(stopping),  # points beyond the braking envelope
            further={name: getattr(self, name) for name in _FURTHER},
            **{name: getattr(self, name) for name in _UNCHANGED},
        )
        named = cast("tuple[str | Rule, ...] | None", self.rules) or ("paper" if self.subject is None else "road",)
        rules = judged_at(named, place) if takes_rule else (None,)
        traffic = cast("tuple[Policy | None, ...]", self.traffic)  # without a subject, the only policy is None
        resolved = Resolved(self.place, selection, traffic, rules, tuple(self.requirement or ()))
        resolved.check()
        return resolved


def one_or_several(name: str, value: Any) -> tuple[Any, ...] | None:
    """Return the value or values of an argument of a mark as a tuple, or None for None."""
    return several(name, value, *_SEVERAL[name])


def judged_at(names: Sequence[str | Rule], place: Junction) -> tuple[Rule, ...]:
    """Return the rules among `names` (rules and rulebooks) that apply to the signs or lights of a junction."""
    rules = rules_for(names, place)
    if not rules:
        raise ScenarioError(
            f"no rule of {', '.join(map(repr, names))} is about a junction with control {place.control.value!r} like "
            f"{place.name!r}: name rules outright, `rvads rules` lists them"
        )
    for rule in rules:
        claim(rule)
    return rules


_UNCHANGED = ("occupancy", "classes", "subject", "followers", "senses", "pedestrians")
"""Arguments of the mark that are passed to `Selection` unchanged."""
_FURTHER = ("duration", "aggression", "wait")
"""Arguments of the mark that are passed to every `Scenario` unchanged."""


def _values_of(name: str, axis: Any) -> list[float | tuple[float, ...]] | None:
    """Return the distances or speeds to run in succession, each a number for all entrances or a tuple with a number for each.

    The number of entrances is checked when the junction is known.
    """
    axis = plain(axis)
    entries = list(map(plain, axis)) if isinstance(axis, list) else [] if axis is None else [axis]
    if axis == []:
        raise ScenarioError(f"{name} is an empty list: give at least one value")
    for entry in entries:
        per_entrance(name, entry, len(entry) or 1 if isinstance(entry, Sequence) else 1)
    return [tuple(entry) if isinstance(entry, Sequence) else entry for entry in entries] or None


def _policies_of(traffic: Any) -> tuple[Policy, ...]:
    is_list = isinstance(traffic, Iterable) and not isinstance(traffic, str) and not callable(traffic)
    named = tuple(traffic) if is_list else (DEFAULT if traffic is None else traffic,)
    if not named:
        raise ScenarioError("traffic is empty: name a policy or an autopilot, or leave it out")
    return tuple(map(Policy.of, named))
