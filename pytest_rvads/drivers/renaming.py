"""Autopilots that know the vehicles by other names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from pytest_rvads.drivers.interface import Command, Coordinates, Drives, Factory, Observation
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.runs.states import Agent

__all__ = ["renamed"]


def renamed(factory: Factory, names: Mapping[str, str]) -> Factory:
    """Return a factory whose autopilots or traffic system observe the vehicles under other names.

    Args:
        factory: factory of the autopilots or of the traffic system.
        names: per name in the run, the name in the observations.
    """
    return _Renamed(factory, names)


class _Wrapper:
    """A wrapper with all abilities of the wrapped object, and with its name in messages."""

    def __init__(self, inner: Any, names: Mapping[str, str]) -> None:
        self._inner, self._names = inner, names
        self.label = name_of(inner)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # no ability; copying and unpickling ask for such attributes before `_inner` exists
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self._inner, name)


class _Renamed(_Wrapper):
    def __call__(self) -> Drives | Coordinates:
        driver = self._inner()
        return _System(driver, self._names) if callable(getattr(driver, "autopilots", None)) else _Pilot(driver, self._names)


class _Pilot(_Wrapper):
    def control(self, seen: Observation) -> Command:
        names = self._names
        others = tuple([other._replace(name=names[other.name]) for other in seen.others])
        command: Command = self._inner.control(seen._replace(me=seen.me._replace(name=names[seen.me.name]), others=others))
        return command


class _System(_Wrapper):
    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        renamed_agents = [replace(agent, name=self._names[agent.name]) for agent in agents]
        return [_Pilot(pilot, self._names) for pilot in self._inner.autopilots(renamed_agents)]
