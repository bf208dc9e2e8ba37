"""The options that several commands share, and the things that the options name: driver, executor, starts of two vehicles.

The library distributed (Dask) is imported only for ``-j ADDRESS``. Callers of `rvads.campaign` pass an executor.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli.common import MAP_FORMATS, named_rules, warn
from pytest_rvads.support.errors import AutopilotError, MapError, RvadsError, ScenarioError, needs
from pytest_rvads.support.executors import Apart

if TYPE_CHECKING:
    from pytest_rvads.geometry.junction import Junction
    from pytest_rvads.satellites.starts.starts import Line
    from pytest_rvads.satellites.starts.trials import Setting

_SHARED: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "autopilot": (("--autopilot",), {"metavar": "NAME", "help": "driver: module:name, reference, or a traffic policy"}),
    "sut": (("--sut",), {"metavar": "COMMAND", "help": "driver: a program that speaks the protocol of stacks"}),
    "simulator": (("--simulator",), {"metavar": "NAME", "help": "simulator of the runs, a name or module:name"}),
    "traffic": (("--traffic",), {"metavar": "POLICY", "help": "driver of the other vehicles (default: reference)"}),
    "occupancy": (
        ("--occupancy",),
        {"choices": ("arms", "lanes"), "default": "arms", "help": "a vehicle per arm or per lane (default: arms)"},
    ),
    "rules": (
        ("--rules",),
        {"action": "append", "metavar": "RULE", "help": "a rule, rulebook or file of rules; repeatable (default: road)"},
    ),
    "map": (("--map",), {"metavar": "FILE", "help": f"map file ({MAP_FORMATS}) of the junction"}),
    "junction": (("--junction",), {"metavar": "ID", "help": "junction: an id in the map, or a built-in name"}),
    "workers": (
        ("-j", "--workers"),
        {
            "metavar": "N|ADDRESS",
            "help": "number of processes (default: one per processor), or the Dask scheduler whose workers are used, such as "
            "tcp://10.0.0.1:8786",
        },
    ),
    "baseline": (("--baseline",), {"metavar": "FILE.json", "help": "report of an earlier session, to compare with"}),
    "strict": (("--strict",), {"action": "store_true", "help": "stop at the first line that can't be read"}),
    "json": (("--json",), {"action": "store_true", "help": "print one JSON object"}),
    "svg": (("--svg",), {"metavar": "OUT", "help": "also draw the answer into this file"}),
    "output": (("-o", "--output"), {"metavar": "OUT", "help": "file to write"}),
}
"""The options that several commands have, each declared once: flags, and settings of `argparse`."""
_PATIENCE = 20
"""Longest time for a scheduler to answer, at the beginning and after a lost connection [s]."""


def share(parser: argparse._ActionsContainer, *names: str, **changed: Any) -> None:
    """Add options that several commands have; `changed` replaces settings of `argparse` that differ at this command."""
    for name in names:
        flags, settings = _SHARED[name]
        parser.add_argument(*flags, **(settings | changed))


def declare_driver(parser: argparse.ArgumentParser) -> None:
    """Add the options ``--autopilot`` and ``--sut``, which name the driver of the vehicle under test, to a command."""
    share(parser.add_mutually_exclusive_group(), "autopilot", "sut")


@contextmanager
def opened_driver(options: argparse.Namespace) -> Iterator[Any]:
    """Yield the driver that the options name; a program that drives is ended when the context ends."""
    from pytest_rvads.drivers.naming import chosen

    if options.sut is not None:
        from pytest_rvads.drivers.stacks.process import Process

        with Process(options.sut) as stack:
            if shutil.which(stack.command[0]) is None:
                raise AutopilotError(
                    f"--sut must be the command of a program that exists and may be executed, got {options.sut!r}"
                )
            yield stack
    elif options.autopilot is not None:
        yield chosen(options.autopilot, Path.cwd(), "--autopilot")
    else:
        raise AutopilotError(
            "no driver is named: name the driver by --autopilot module:name or --sut COMMAND (--autopilot reference for the "
            "reference driver)"
        )


@contextmanager
def opened_executor(options: argparse.Namespace) -> Iterator[Executor | int]:
    """Yield the executor that the options name, for `spread` and `campaign`; a connection to a scheduler is closed at the end."""
    if options.workers is None or options.workers.lstrip("-").isdecimal():
        yield Apart(processes(options))
        return
    if not find_spec("distributed"):
        raise RvadsError(needs("-j ADDRESS", "distributed", "dask"))
    from distributed import Client

    try:
        client = Client(options.workers, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RvadsError(
            f"no Dask scheduler answers at {options.workers!r} ({type(error).__name__}: {error}): expected an address such as "
            "tcp://10.0.0.1:8786, as `dask scheduler` prints it"
        ) from error
    try:
        yield client.get_executor(pure=False)
    finally:
        client.close(timeout=_PATIENCE)


def declare_rules(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--rules`` to a command whose other arguments stand before its options: it takes several rules at once."""
    help = "rules, rulebooks or files of rules (default: road)"
    share(parser, "rules", action="extend", nargs="+", help=help)


def processes(options: argparse.Namespace, usual: int | None = None) -> int:
    """Return the number of processes that ``-j`` states, by default `usual` or one per processor."""
    text = options.workers or str(usual or os.cpu_count() or 1)
    if not text.lstrip("-").isdecimal():
        raise ScenarioError(f"--workers must be a number of processes for this command, got {text!r}")
    if int(text) < 1:
        raise ScenarioError(f"--workers must be at least 1, got {text}")
    return int(text)


def declare_starts(parser: argparse.ArgumentParser) -> None:
    """Add the options for junctions, driver, traffic, simulator, rules and executor to a command about starts of two vehicles."""
    parser.add_argument("place", metavar="JUNCTION|MAP", help=f"built-in junction, or map file ({MAP_FORMATS})")
    share(parser, "junction", help="id of a junction of the map (default: all with conflicting ways)")
    declare_driver(parser)
    share(parser, "traffic", default="reference")
    parser.add_argument(
        "--pedestrians",
        nargs="+",
        default=[],
        metavar="BEHAVIOUR",
        help="instead of another vehicle, meet a pedestrian on a crosswalk; a behaviour such as steady or darts",
    )
    share(parser, "simulator", "workers")
    declare_rules(parser)


def setting_of(options: argparse.Namespace, driver: Any) -> Setting:
    """Return the settings that all runs of a command share: driver, rules, traffic and simulator."""
    from pytest_rvads.satellites.starts.trials import Setting
    from pytest_rvads.simulators.simulator import named

    simulator = named(options.simulator, Path.cwd())
    return Setting.of(driver, named_rules(options.rules or ["road"]), options.traffic, simulator=simulator)


def map_of(options: argparse.Namespace) -> str | None:
    """Return the map file that the options name; None if the options name a built-in junction."""
    from pytest_rvads.geometry.finder import names

    place: str = options.place
    if place in names():
        if options.junction:
            raise MapError(f"--junction names a junction of a map, and {place!r} is a built-in junction: leave it out")
        return None
    if not Path(place).exists():
        raise MapError(f"{place!r} is no built-in junction ({', '.join(names())}) and no file: name one of these")
    return place


def conflicting(map: str) -> list[str]:
    """Return the ids of the junctions of a map in which ways conflict."""
    from pytest_rvads.geometry.conflicts import JunctionKind
    from pytest_rvads.geometry.road_map import describe, read_map

    return [one["id"] for one in describe(read_map(map))["junctions"] if one["kind"] not in (None, JunctionKind.CONFLICT_FREE)]


def places(options: argparse.Namespace) -> Iterator[Junction]:
    """Yield the junctions that the options name; of a whole map, those without a line of starts are left out with a warning."""
    from pytest_rvads.drivers.walking import behaviour
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.satellites.starts.starts import lines_at

    for name in options.pedestrians:
        behaviour(name)
    map = map_of(options)
    if map is None or options.junction:
        yield find(options.junction or options.place, map)
        return
    ids = conflicting(map)
    if not ids:
        raise MapError(f"{map} has no junction in which ways conflict: `rvads map {shlex.quote(map)}` says why")
    left_out: list[ScenarioError] = []
    for place in (find(id, map) for id in ids):
        try:
            lines_at(place, behaviours=options.pedestrians)
        except ScenarioError as error:
            left_out.append(error)
            warn(f"rvads: {error}")
        else:
            yield place
    if len(left_out) == len(ids):
        raise ScenarioError(f"{map} has no junction with a line of starts, for the reasons above: use another map")


def program(options: argparse.Namespace) -> list[str]:
    """Return the first words of a command line that repeats a command, with the side of traffic if one was stated."""
    return ["rvads", *(["--hand", options.hand] if getattr(options, "hand", None) else [])]


def again(options: argparse.Namespace, place: Junction, id: str) -> str:
    """Return the command that simulates the start with the id `id` once more."""
    words = [*program(options), "critical", options.place, *(["--junction", place.id] if place.map else [])]
    words += [word for name in ("autopilot", "sut") if (value := getattr(options, name)) for word in (f"--{name}", value)]
    words += ["--traffic", options.traffic] if options.traffic != "reference" else []
    words += ["--simulator", options.simulator] if options.simulator else []
    words += ["--rules", *options.rules] if options.rules else []
    return shlex.join([*words, "--start", id])


def start_of(line: Line, lead: int, setting: Setting) -> dict[str, Any]:
    """Return a start of a line as a JSON object: lead [s], id, distance [m] and speed [m/s] per vehicle."""
    from pytest_rvads.satellites.starts.starts import STEP

    scenario = line.scenario(lead)
    entrances = [start for start, _ in line.ways if start < len(line.place.entrances)]
    return {
        "lead": round(lead * STEP, 2),
        "id": setting.id(scenario),
        "distances": [scenario.start(entrance)[0] for entrance in entrances],
        "speeds": [scenario.start(entrance)[1] for entrance in entrances],
    }
