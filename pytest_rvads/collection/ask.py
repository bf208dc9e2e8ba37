"""What a test asks for: the arguments of ``@rvads.scenario``, checked when it is written and resolved at collection.

A mark is checked where it is written. The `Ask` is frozen and has the file and line of the mark, so that an error that only the
junction or the session can show still names this line.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pytest_rvads.collection.arguments import SEVERAL, Values, policies_of, refuse, values_of
from pytest_rvads.collection.extensions import Extensions
from pytest_rvads.collection.misuse import several
from pytest_rvads.collection.resolved import Found, NoRoom, Resolved
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.errors import ScenarioError, suggest
from pytest_rvads.junctions.builtin import LAYOUTS
from pytest_rvads.junctions.choosing import EVERY, choose_among, some
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.junctions.kinds import Kinds
from pytest_rvads.logic.rules.book import claim, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.options import Options
from pytest_rvads.scenarios.classes import parse
from pytest_rvads.scenarios.configurations import ARRIVALS, Configuration, explicit, grid, outside
from pytest_rvads.scenarios.scenario import check_followers, check_numbers
from pytest_rvads.scenarios.selection import CHOOSING, Selection
from pytest_rvads.scenarios.senses import IDEAL, Senses

__all__ = ["Ask", "judged_at"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ask:
    """What ``@rvads.scenario`` asks for, see there; None leaves it to the session."""

    place: str
    """File and line of the mark."""
    junction: tuple[str, ...]
    """Names, ids, types or places, one after the other."""
    kinds: Kinds | None
    """Which of these, None for all."""
    limit: int | None
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
    def of(cls, place: str, arguments: Mapping[str, Any], misspelt: Iterable[str]) -> Ask:
        """Check the arguments of a mark as far as possible without junction and session.

        Args:
            place: file and line of the mark.
            arguments: the keywords of `scenario` with their values.
            misspelt: further keywords, which are refused.

        Raises:
            ScenarioError: an argument of a wrong type, an empty list, or arguments that exclude each other.
        """
        checked = dict(arguments)
        for wrong in misspelt:
            raise ScenarioError(f"@rvads.scenario takes {', '.join(checked)}, got {wrong!r}{suggest(wrong, checked)}")
        refuse(arguments)
        check_numbers(arguments["duration"], arguments["aggression"], arguments["wait"])
        for name, (kind, what) in SEVERAL.items():
            if not (name == "senses" and isinstance(arguments[name], Mapping)):
                checked[name] = several(name, arguments[name], kind, what)
        kinds = checked.pop("junctions")
        checked |= {
            "junction": checked["junction"] or (EVERY,),
            "kinds": None if kinds is None else Kinds.of(kinds),
            "distances": values_of("distances", arguments["distances"]),
            "speeds": values_of("speeds", arguments["speeds"]),
            "traffic": (None,) if arguments["subject"] is None else policies_of(arguments["traffic"]),
            "senses": Senses.grid(arguments["senses"])
            if isinstance(arguments["senses"], Mapping)
            else checked["senses"] or (IDEAL,),
            "requirement": checked["requirement"] or (),
            "followers": checked["followers"] or (0,),
        }
        for count in checked["followers"]:
            check_followers(count)
        return cls(place=place, **checked)

    def resolve(
        self,
        folder: Path,
        options: Options,
        added: Extensions,
        watch: Callable[..., Iterable[Configuration]],
        takes_rule: bool,
    ) -> Found:
        """Return what to run, of a test in `folder`.

        Args:
            folder: of the file of the test.
            options: of the session.
            added: what users add by hooks.
            watch: yields configurations and tells how many are done.
            takes_rule: whether the test runs over rules.

        Raises:
            RvadsError: a junction does not exist, or no junction fits the arguments of the mark.
        """
        sources = [self._source(name, folder, options.map, added) for name in self.junction]
        choice = choose_among(sources, kinds=self.kinds)
        places = [place.limited(options.speed_limit) if options.speed_limit else place for place in choice.junctions]
        here: dict[Junction, Resolved] = {}
        wrong: dict[Junction, ScenarioError] = {}
        while True:  # what is left out does not count against the limit
            rest = [place for place in places if place not in wrong]
            drawn = some(rest, self.limit, options.seed) if rest else ()
            anew = [place for place in drawn if place not in here]
            if not anew:
                break
            for place in anew:
                try:
                    here[place] = self._at(place, options, added.grids, watch, takes_rule)
                except ScenarioError as error:
                    wrong[place] = error
        if not drawn:
            first, many = next(iter(wrong.values())), len(places)
            raise first if many == 1 else ScenarioError(f"none of {many} junctions has what is asked for, the first: {first}")
        left_out = [(one.name, one.reason) for one in choice.refused]
        left_out += [(place.name, _reason(error, place)) for place, error in wrong.items()]
        return Found(tuple(here[place] for place in drawn), tuple(left_out), len(rest) - len(drawn))

    def _at(
        self,
        place: Junction,
        options: Options,
        grids: Mapping[str, tuple[Any, Any]],
        watch: Callable[..., Iterable[Configuration]],
        takes_rule: bool,
    ) -> Resolved:
        """Return what to run at a junction.

        Raises:
            ScenarioError: it does not have what is asked for, or no scenario of it has room for its vehicles.
        """
        configurations, left_out = self._configurations(place, options, grids, watch)
        entrances, codes = len(place.entrances), []
        for text in self.scenarios or ():
            codes.append(code := parse(text))
            if len(code) != entrances:
                raise ScenarioError(f"scenario {text!r} names {len(code)} entrances, junction {place.name!r} has {entrances}")
        cover = self.cover or options.cover
        if cover in CHOOSING and (self.classes or self.scenarios):  # that of the session is for tests that name none
            cover = "class"
        selection = Selection(
            place,
            configurations,
            cover,
            scenarios=tuple(codes) or None,
            left_out=left_out,
            **{name: getattr(self, name) for name in _SAME},
        )
        rules = self.judged_by(place) if takes_rule else (None,)
        resolved = Resolved(self.place, selection, self.traffic, rules, self.requirement)
        resolved.check()
        return resolved

    def judged_by(self, place: Junction) -> tuple[Rule, ...]:
        """Return the rules to judge runs at a junction by.

        Raises:
            RvadsError: no such rule, none about this kind of junction, or one of a name that means another one elsewhere.
        """
        return judged_at(self.rules or ("paper" if self.subject is None else "road",), place)

    def _source(self, junction: str, folder: Path, default: str | None, added: Extensions) -> tuple[str, str | None]:
        """Return the name of a junction and the path of its map file, as `find` takes the two."""
        if self.map is not None:
            beside = folder / self.map
            return junction, str((beside if beside.exists() else Path(self.map)).resolve())
        if junction in added.junctions:
            file, name = added.junctions[junction]
            return name, file
        return junction, None if junction in LAYOUTS else default

    def _configurations(
        self,
        place: Junction,
        options: Options,
        grids: Mapping[str, tuple[Any, Any]],
        watch: Callable[..., Iterable[Configuration]],
    ) -> tuple[tuple[Configuration, ...], int]:
        """Return the configurations to run, and how many were left out because nobody could stop there."""
        ways, names = len(place.entrances), self.grid or (options.grid or ("paper" if self.subject is None else ARRIVALS),)
        axes = [grids[name] for name in names if name in grids]
        letters = [name for name in names if name not in grids]
        if self.distances:
            axes, letters = [(list(self.distances), list(self.speeds or (0.0,)))], []
        paper = grid(letters, ways, place.control) if letters else ()
        own = [configuration for distances, speeds in axes for configuration in explicit(distances, speeds, ways)]
        kept = own if self.probe or not own else self._stopping(own, place, watch)
        if own and not kept and not paper:
            asked = f"distances={axes[0][0]!r}, speeds={axes[0][1]!r}" if self.distances else f"grid={names!r}"
            raise ScenarioError(
                f"every point of {asked} is too fast to stop before the line "
                "(`rvads braking` lists v(d)max): lower the speeds, or say probe=True to run them all the same"
            )
        return tuple(dict.fromkeys((*paper, *kept))), len(own) - len(kept)

    def _stopping(
        self, points: Sequence[Configuration], place: Junction, watch: Callable[..., Iterable[Configuration]]
    ) -> list[Configuration]:
        """Return the points from which vehicles can stop, as the simulator of the session has it."""
        from pytest_rvads.simulators.simulator import vmax  # most tests need no physics before they run

        return [point for point in watch(points) if not outside(point, lambda d: vmax(d, self.aggression, limit=place.top_limit))]


def _reason(error: ScenarioError, place: Junction) -> str:
    """Return why a junction is left out, in words that are the same for others."""
    if isinstance(error, NoRoom):
        return "no scenario has room for its vehicles where they would start"
    return str(error).replace(f"junction {place.name!r}", "the junction").replace(f" like {place.name!r}", "")


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
"""Arguments of the mark that are passed to `Selection` unchanged."""
