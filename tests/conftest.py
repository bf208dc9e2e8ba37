"""Fixtures shared by the tests of all packages: runs written by hand, among others."""

import os
import signal
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, fromstring, tostring

import numpy as np
import pytest
from msgspec import structs

import pytest_rvads
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic import check as checking
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.current import own_desk
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import Collision, Facts, Run
from pytest_rvads.runs.states import Agent, Colour, Zone
from tools.crossings import Layout, opendrive

from .left_patched import Attributes

Make = Callable[..., Run]
_OWN = {"road": "id", "signal": "id", "object": "id", "controller": "id", "control": "signalId", "connection": "incomingRoad"}
"""Attributes that hold an id, by element, in maps that become part of a town."""

pytest_plugins = ["pytester"]

os.environ["RVADS_CACHE"] = ""  # no test depends on, or leaves, what earlier ones found

# Inner sessions of pytester forget the modules they load: that costs a second each, and modules in C can't be loaded twice.
for _name in pytest_rvads.__all__:
    getattr(pytest_rvads, _name)
for _name in (
    "hypothesis",
    "numpy.fft",
    "pytest_rvads.report.scene",
    "pytest_rvads.satellites.pages.replay",
    "pytest_rvads.report.terminal",
):
    import_module(_name)


WITHOUT = "-p no:hypothesispytest -p no:html -p no:randomly"
"""Options of sessions within tests: one of these plugins imports all of Hypothesis at the end of every session, which takes
longer than most of the sessions, the next a language of templates at its beginning; the last shuffles the items."""


@pytest.fixture(scope="session", autouse=True)
def _processes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What tests start compiles each module once, even where nothing may be written beside modules, and can be interrupted.

    In the background and under nohup, shells have signals ignored, and so would be the processes that tests start. A signal with
    a handler has its default action there.
    """
    _ATTRIBUTES.learn()
    for name in ("SIGINT", "SIGQUIT", "SIGHUP"):
        number = getattr(signal, name, None)
        if number and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, lambda *_: None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTEST_ADDOPTS", WITHOUT)
        if "PYTHONDONTWRITEBYTECODE" in os.environ:
            patch.delenv("PYTHONDONTWRITEBYTECODE")
            patch.setenv("PYTHONPYCACHEPREFIX", str(tmp_path_factory.mktemp("bytecode")))
        yield


_ATTRIBUTES = Attributes()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Fail a test that leaves an attribute of the package replaced, or the last test of its file."""
    yield
    last = nextitem is None or nextitem.path != item.path
    left = _ATTRIBUTES.restore(everything=last)
    if last:
        _ATTRIBUTES.learn()
    if left:
        who = f"{item.nodeid}, or an earlier test of its file," if last else item.nodeid
        pytest.fail(f"{who} left {', '.join(left)} replaced: undo patches in the reverse order", pytrace=False)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
    result = yield
    if fixturedef.scope != "function":
        _ATTRIBUTES.forget()
    return result


@pytest.fixture(autouse=True)
def _few_plugins(request: pytest.FixtureRequest) -> Iterator[None]:
    """The same options hold where `pytester` has cleared them."""
    if "pytester" in request.fixturenames:
        request.getfixturevalue("pytester")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTEST_ADDOPTS", WITHOUT)
        yield


@pytest.fixture(autouse=True)
def _book() -> Iterator[None]:
    """What a test registers, or a command that it runs in this process, is forgotten at its end."""
    with own_desk():
        yield


@pytest.fixture
def doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What would pass is UNSURE in sessions within this test, as if the recordings were too inexact to tell."""
    why = "a0 stood for 0.02 s, known to 0.05 s"

    def check(run: Run, rule: str | Rule) -> Verdict:
        found = judged(run, rule)
        if found.status != Status.PASS:
            return found
        hanging = tuple(structs.replace(one, status=Status.UNSURE, hangs=why) for one in found.instances)
        message = f"{found.rule} UNSURE: {why}"
        return structs.replace(found, status=Status.UNSURE, message=message, reason=why, instances=hanging)

    judged = checking.check
    monkeypatch.setattr(checking, "check", check)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of maps and recordings by other people; tests that need it skip where it is absent."""
    folder = Path(__file__).parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip("the folder ../shared with maps and recordings by other people is absent")
    return folder


@pytest.fixture(scope="session")
def write_town() -> Callable[..., Path]:
    """Return a function that writes a map of several junctions, 400 m apart from west to east, and returns its path.

    It takes a path, a `Layout` per id of a junction, and the ids of those of a type that can't be used.
    """

    def write(path: Path, layouts: Mapping[str, Layout], virtual: Sequence[str] = ()) -> Path:
        town = Element("OpenDRIVE")
        for number, (id, layout) in enumerate(layouts.items()):
            part = fromstring(opendrive(layout).encode())
            for element in part.iter():
                for key in {_OWN.get(element.tag), "connectingRoad", "elementId"} & set(element.attrib):
                    own = "" if element.get("elementType") == "junction" else f"_{element.get(str(key))}"
                    element.set(str(key), id + own)
                if element.tag == "geometry":
                    element.set("x", str(float(element.attrib["x"]) + 400.0 * number))
                if element.get("junction", "-1") != "-1":
                    element.set("junction", id)
            for junction in part.iter("junction"):
                junction.attrib |= {"id": id, "type": "virtual" if id in virtual else "default"}
            town.extend(part)
        path.write_bytes(tostring(town))
        return path

    return write


@pytest.fixture(scope="session")
def make() -> Make:
    """Return a function that makes a run without positions.

    It takes the name of a built-in junction; per entrance the direction and the ticks at which the vehicle arrives, enters
    the junction and leaves it (None: never); the number of ticks; and per entrance [(tick, colour), ...].
    """

    def build(
        junction: str,
        vehicles: Mapping[int, tuple[int, int | None, int | None, int | None]],
        steps: int,
        lights: Mapping[int, Sequence[tuple[int, Colour]]] | None = None,
    ) -> Run:
        place = find(junction)
        agents, zones = [], []
        for entrance, (direction, *ticks) in vehicles.items():
            leaving = place.leads(entrance, direction).exit
            agents.append(Agent(f"a{entrance}", place.movements[entrance, leaving]))
            zone = np.full(steps, Zone.APPROACH, dtype=np.int8)
            for tick, part in zip(ticks, (Zone.ENTRANCE, Zone.JUNCTION, Zone.EXIT), strict=True):
                if tick is not None:
                    zone[tick:] = part
            zones.append(zone)
        colours = np.zeros((steps, place.ways), dtype=np.int8)
        for entrance in lights or {}:
            for tick, colour in (lights or {})[entrance]:
                colours[tick:, entrance] = colour
        return Run("by-hand", place, tuple(agents), np.column_stack(zones), colours)

    return build


@pytest.fixture(scope="session")
def drive() -> Make:
    """Return a function that makes a run along the centre lines from speeds.

    It takes a junction, or the name of a built-in one; per entrance, or entrance and number in its queue, the direction, the
    station at the start [m], [(tick, speed [m/s]), ...], and how far to the left of the centre line to drive [m], 0 by default;
    the number of ticks; lights as in `make`; collisions as (tick, name, name); length and width of all vehicles [m]; further
    facts.
    """

    def build(
        junction: str | Junction,
        vehicles: Mapping[Any, tuple[Any, ...]],
        steps: int,
        lights: Mapping[int, Sequence[tuple[int, Colour]]] | None = None,
        collisions: Sequence[tuple[int, str, str]] = (),
        size: tuple[float, float] | None = (4.6, 1.86),
        **facts: Any,
    ) -> Run:
        place = find(junction) if isinstance(junction, str) else junction
        agents, columns = [], []
        for seat, (direction, start, speeds, *beside) in vehicles.items():
            entrance, queued = (seat, 0) if isinstance(seat, int) else seat
            leaving = place.leads(entrance, direction).exit
            name = place.vehicle_at(entrance) + (f"+{queued}" if queued else "")
            agents.append(Agent(name, place.movements[entrance, leaving], size=size))
            speed = np.zeros(steps)
            for tick, value in speeds:
                speed[tick:] = value
            station = start + np.concatenate(([0.0], np.cumsum(speed[:-1]))) * 0.01
            line, length = -place.setbacks[entrance], place.movements[entrance, leaving].length
            zone = np.select(
                [station < line - 1.0, station <= 0.0, station < length], [Zone.APPROACH, Zone.ENTRANCE, Zone.JUNCTION], Zone.EXIT
            )
            itinerary = Itinerary.through(place, entrance, leaving)
            pose = np.array([itinerary.pose(float(s)) for s in station])
            pose[:, :2] += sum(beside) * np.stack((-np.sin(pose[:, 2]), np.cos(pose[:, 2])), axis=-1)
            columns.append((zone.astype(np.int8), station, speed, pose))
        colours = np.zeros((steps, len(place.starts)), dtype=np.int8)
        for entrance in lights or {}:
            for tick, colour in (lights or {})[entrance]:
                colours[tick:, entrance] = colour
        zone, station, speed, pose = (np.stack([c[k] for c in columns], axis=1) for k in range(4))
        return Run(
            "by-hand",
            place,
            tuple(agents),
            zone,
            colours,
            station=station,
            speed=speed,
            pose=pose,
            collisions=tuple(Collision(tick * 0.01, (one, two), 1.0) for tick, one, two in collisions),
            facts=Facts(**{"speed_limit": 11.176, **facts}),
        )

    return build


@pytest.fixture(scope="session")
def topology() -> Callable[[Junction], Junction]:
    """Return a function that returns a junction of which nobody knows where its lanes lie."""

    def build(junction: Junction) -> Junction:
        return replace(
            junction,
            entrances=tuple(replace(e, approach=None) for e in junction.entrances),
            exits=tuple(replace(e, road=None) for e in junction.exits),
            movements={key: replace(m, path=None) for key, m in junction.movements.items()},
        )

    return build
