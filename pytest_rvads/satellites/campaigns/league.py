"""A league: several drivers are judged on the same drawn cells, and on the same lines of starts of two vehicles."""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from pytest_rvads.cli.common import listed_rules
from pytest_rvads.cli.shared_options import again
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.naming import stand_in
from pytest_rvads.drivers.traffic import Policy, policy_name
from pytest_rvads.geometry.finder import choose
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.satellites.campaigns.town_plan import Plan, Request
from pytest_rvads.satellites.starts.starts import Line, lines_at
from pytest_rvads.scenarios.case import Case
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.errors import RvadsError, ScenarioError
from pytest_rvads.support.storage import read_file
from pytest_rvads.support.stratified import draw

_LARGEST = 2**20
"""Largest configuration that is read [bytes]."""
_Positive = Annotated[int, Meta(ge=1, le=10**6)]
_Name = Annotated[str, Meta(min_length=1, max_length=100)]


class DriverConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A driver of a league: either an autopilot or a program."""

    autopilot: str | None = None
    """``module:name`` or a traffic policy, as for ``--autopilot``."""
    sut: str | None = None
    """A program that speaks the protocol of stacks, as for ``--sut``."""
    simulator: str | None = None
    """Simulator of the driver's runs; None for the default simulator."""

    def words(self, **more: object) -> argparse.Namespace:
        """Return the options of a command that name the driver, and further options."""
        return argparse.Namespace(autopilot=self.autopilot, sut=self.sut, simulator=self.simulator, **more)


class MapConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A map, and the number of its junctions to draw."""

    file: str
    junctions: _Positive


class Config(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The configuration of a league. Paths are relative to the working directory."""

    drivers: Annotated[dict[_Name, DriverConfig], Meta(min_length=1)]
    cells: _Positive
    """Number of runs of each driver, spread evenly over traffic policies, seats, junctions, classes and configurations."""
    junctions: tuple[str, ...] = ()
    """Names of built-in junctions."""
    maps: tuple[MapConfig, ...] = ()
    """Maps of which junctions are drawn."""
    seats: tuple[int, ...] = ()
    """Entrances of the vehicle under test; empty for all entrances."""
    traffic: Annotated[tuple[str, ...], Meta(min_length=1)] = ("reference",)
    """Traffic policies."""
    critical: Annotated[int, Meta(ge=0, le=10**6)] = 0
    """Number of lines of starts on which critical starts are searched."""
    rules: Annotated[tuple[str, ...], Meta(min_length=1)] = ("road",)
    """Rules, rulebooks or files of rules."""
    seed: Annotated[int, Meta(ge=0, le=2**53)] = 0
    """Seed of all draws."""

    @classmethod
    def read(cls, path: Path) -> Config:
        """Return the configuration in a TOML file."""
        try:
            content = tomllib.loads(read_file(path, _LARGEST).decode())
        except OSError as error:
            raise RvadsError(
                f"{path} can't be read: {error.strerror or error}, expected the configuration of a league in TOML"
            ) from error
        except (ValueError, RecursionError) as error:
            raise RvadsError(f"{path} must hold a league in TOML: {error}") from error
        config = typed(content, cls, str(path), RvadsError)
        for name, driver in config.drivers.items():
            if (driver.autopilot is None) is (driver.sut is None):
                given = "none" if driver.sut is None else "both"
                raise RvadsError(f"{path}: the field 'drivers.{name}' must have an autopilot or a sut, got {given}: give one")
        return config


@contextmanager
def about(place: str) -> Iterator[None]:
    """Let errors of the package begin with the place in the configuration that they are about."""
    try:
        yield
    except RvadsError as error:
        raise RvadsError(f"{place}: {error}") from error


@dataclass(eq=False)
class League:
    """The drawn cells and lines of starts of a league, on which every driver is judged."""

    config: Config
    path: Path

    def __post_init__(self) -> None:
        config = self.config
        with about(f"{self.path}: junctions"):
            chosen = [*choose(config.junctions).junctions] if config.junctions else []
        with about(f"{self.path}: maps"):
            for map in config.maps:
                chosen += choose("*", map.file, limit=map.junctions, seed=config.seed).junctions
        with about(f"{self.path}: rules"):
            self.rules = listed_rules(config.rules)
        with about(f"{self.path}: traffic"):
            policies = [Policy.of(name) for name in dict.fromkeys(config.traffic)]
        seats: list[int | str] = [*dict.fromkeys(config.seats)] or ["all"]
        requests = [Request(stand_in(), self.rules, subject=seat, traffic=policy) for policy, seat in product(policies, seats)]
        sizes = [len(range(number, config.cells, len(requests))) for number in range(len(requests))]
        self.plans = [
            Plan(chosen, request, sample=size, seed=config.seed) for request, size in zip(requests, sizes, strict=True) if size
        ]
        if not self.cells:
            raise RvadsError(f"{self.path}: no cell is possible: {next(iter(self.refused), 'name junctions or maps')}")

    @property
    def refused(self) -> list[str]:
        """The reasons why none of the requested cells is possible at a junction."""
        return list(dict.fromkeys(f"{name}: {reason}" for plan in self.plans for name, reason in plan.refused.items()))

    @cached_property
    def cells(self) -> dict[str, Case]:
        """The cases of the stand-in for the drivers, by name of the run."""
        return {planned.name: planned.case for plan in self.plans for planned in plan}

    @property
    def places(self) -> list[Junction]:
        """The junctions of the cells."""
        return list(dict.fromkeys(case.scenario.place for case in self.cells.values()))

    def cases(self, driver: Factory) -> dict[str, Case]:
        """Return the cases of a driver, by name of the run."""
        return {name: Case(case.scenario, driver, case.traffic, case.fleet) for name, case in self.cells.items()}

    def again(self, driver: str, run: str) -> str:
        """Return the command that simulates a run of a driver again, given the names of both."""
        case = self.cells[run]
        assert case.traffic is not None
        return self.rerun(driver, case.scenario.place, run, policy_name(case.traffic))

    def rerun(self, driver: str, place: Junction, id: str, traffic: str) -> str:
        """Return the command that simulates a scenario of a driver again, given its id and its traffic policy."""
        options = self.config.drivers[driver].words(
            place=str(place.map or place.name), traffic=traffic, rules=list(self.config.rules)
        )
        return again(options, place, id)

    @cached_property
    def lines(self) -> list[Line]:
        """The drawn lines of starts, among the lines that differ by more than a rotation."""
        lines: list[Line] = []
        for place in self.places if self.config.critical else ():
            try:
                lines += [group[0] for group in lines_at(place, self.config.seats or None)]
            except ScenarioError:  # no two ways conflict, or a junction lacks a seat: it has no lines
                continue
        if not lines:
            return []
        return draw(
            lines, self.config.critical, self.config.seed, lambda line: (line.place.name, line.vista), lambda line: line.id
        )
