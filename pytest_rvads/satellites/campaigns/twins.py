"""Cases that are equal up to a motion of the plane: one case is simulated, and all cases get its result under their own ids."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from pytest_rvads.satellites.campaigns.judged import Judged
from pytest_rvads.satellites.campaigns.shapes import Member, Shape, twin
from pytest_rvads.satellites.campaigns.town_plan import Plan, Planned
from pytest_rvads.scenarios.case import Case

__all__ = ["Twins"]

_AGENT = re.compile(r"\ba(\d+)(?=(\.\d+)?(\+\d+)?\b)")
_ENTRANCE = re.compile(r"\bentrance (\d+)\b")


@dataclass(frozen=True, slots=True)
class _At:
    """A planned case, with the equal case that is simulated instead."""

    planned: Planned
    case: Case
    member: Member


class Twins:
    """The cases of a plan by those that are simulated in their place; all are in memory, some hundred bytes each.

    Args:
        plan: all cases.
        shapes: of all junctions of the plan at which something runs.
    """

    def __init__(self, plan: Plan, shapes: Sequence[Shape]) -> None:
        members = {member.junction.name: (member, shape) for shape in shapes for member in shape.members}
        self._found: dict[str, list[_At]] = {}
        for planned in plan:
            given = planned.case
            member, shape = members[given.scenario.place.name]
            other = twin(given.scenario, member, shape)
            case = given if other is None else Case(other, given.driver, given.traffic, given.fleet)
            name = planned.name.replace(given.scenario.name, case.scenario.name)
            self._found.setdefault(name, []).append(_At(planned, case, member))

    def __len__(self) -> int:
        return len(self._found)

    def cases(self) -> Iterator[Case]:
        """Yield what is to be simulated."""
        return (twins[0].case for twins in self._found.values())

    def case_of(self, names: Collection[str]) -> dict[str, Case]:
        """Return what is simulated in place of the cases of these names."""
        return {at.planned.name: twins[0].case for twins in self._found.values() for at in twins if at.planned.name in names}

    def spread(self, results: Iterable[Judged]) -> Iterable[Judged]:
        """Return the results of all cases; the iterable can be repeated as often as `results`."""
        return _Spread(self._found, results)


class _Spread:
    def __init__(self, found: dict[str, list[_At]], results: Iterable[Judged]) -> None:
        self._found, self._results = found, results

    def __iter__(self) -> Iterator[Judged]:
        for judged in self._results:
            for at in self._found.get(judged.nodeid, ()):
                yield judged if at.member.junction.name == judged.junction else _moved(judged, at)


def _moved(judged: Judged, at: _At) -> Judged:
    """Return a result as one at another junction of the same shape: agents and entrances may have other numbers there."""
    scenario, place, member = at.planned.case.scenario, at.member.junction, at.member
    told: dict[str, Any] = msgspec.to_builtins(judged)
    if member.rotation:
        entrances = {image: entrance for entrance, image in enumerate(member.entrances)}

        def arm(number: int) -> int:
            return (number - member.rotation) % place.ways

        def renamed(text: str) -> str:
            text = _AGENT.sub(lambda found: f"a{arm(int(found[1]))}", text)
            return _ENTRANCE.sub(lambda found: f"entrance {entrances.get(int(found[1]), found[1])}", text)

        told |= {part: _deeply(told[part], renamed) for part in ("verdicts", "kpis", "timing", "agents") if told.get(part)}
        for agent in told.get("agents", ()):
            for end in ("entrance", "exit"):
                agent[end] = arm(agent[end][0]), agent[end][1]
    told |= {
        "nodeid": at.planned.name,
        "run": at.planned.name,
        "junction": place.name,
        "cls": scenario.number,
        "scenario": scenario.label,
        "cfg": scenario.point,
        "rotation": scenario.rotation,
        "seat": scenario.subject,
        "orbit": scenario.orbit,
        "place": place.digest[: len(judged.place or "")],
        "shape": judged.junction,
    }
    return msgspec.convert(told, Judged)


def _deeply(value: Any, change: Callable[[str], str]) -> Any:
    """Return builtins with every text in them changed."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, dict):
        return {change(key): _deeply(inner, change) for key, inner in value.items()}
    return [_deeply(inner, change) for inner in value] if isinstance(value, list | tuple) else value
