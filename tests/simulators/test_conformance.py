"""The conformance tests of simulators: shipped simulators pass them, and each of many faults is found by the check for it."""

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.runs.states import SignalPlan
from pytest_rvads.satellites.conformance.bench import Bench, NotTried
from pytest_rvads.satellites.conformance.test_conformance import CHECKS, faults, unsupported
from pytest_rvads.simulators.loop import usual
from pytest_rvads.simulators.patience import Watch
from pytest_rvads.simulators.simulator import named

SHIPPED = {"bullet": "pybullet", "mujoco": "mujoco", "sumo": "sumo"}
"""Simulators that have to pass, and the library that each needs."""
FEW = ("stop4", "stop3", "light4")
USUAL = usual()


def bench(simulator: Any, *junctions: str, drivers: Sequence[Any] = (Reference,), **more: Any) -> Bench:
    return Bench(simulator, tuple(drivers), tuple(map(rvads.find, junctions or FEW)), **more)


@pytest.mark.extended
@pytest.mark.parametrize("simulator", SHIPPED)
def test_shipped_simulator_passes_all_conformance_tests(simulator: str, pytester: pytest.Pytester) -> None:
    pytest.importorskip(SHIPPED[simulator])
    result = pytester.runpytest_subprocess(
        "-p", "no:cacheprovider", "--pyargs", "pytest_rvads.satellites.conformance", "--rvads-simulator", simulator
    )
    result.assert_outcomes(passed=len(CHECKS))


@pytest.mark.parametrize("check", ["starts", "speeds", "gone", "running_into"])
def test_short_and_bent_approaches_are_no_fault_of_a_simulator(check: str) -> None:
    assert faults(check, bench(USUAL, "roundabout4")) == ()


class Wrapped:
    """The usual one, between two changes: of the case before it drives, of the run after it has."""

    name = "wrapped"

    def __init__(self, after: Callable[..., Any] | None = None, before: Callable[[rvads.Case], rvads.Case] | None = None) -> None:
        self.after, self.before, self.runs = after, before, 0

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        self.runs += 1
        run = USUAL(self.before(case) if self.before else case, watch)
        run = replace(
            run, label=case.scenario.name, agents=case.agents(), provenance=dict(run.provenance) | {"simulator": self.name}
        )
        if self.before:  # the run says that it is of the case it was asked for
            run = replace(run, facts=replace(run.facts, subject=case.scenario.under_test))
            run = replace(run, provenance=dict(run.provenance) | {"scenario": case.scenario.record()})
        found: rvads.Run = self.after(run) if self.after else run
        return found

    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return USUAL.vmax(distance, aggression, vehicle)


def rows(run: rvads.Run, pick: Any, **more: Any) -> rvads.Run:
    """Return a run of some of the states of another one."""
    arrays = {name: getattr(run, name)[pick] for name in ("zone", "lights", "station", "speed", "pose", "controls")}
    return replace(run, **(arrays | more))


def slowly(run: rvads.Run) -> rvads.Run:
    return rows(run, np.arange(run.steps) // 2)


def back_from_gone(run: rvads.Run) -> rvads.Run:
    zone = np.array(run.zone)
    gone = np.argwhere(zone == rvads.Zone.GONE)
    for tick, column in gone[-1:]:
        zone[tick, column] = rvads.Zone.EXIT
    return replace(run, zone=zone)


def degrees(run: rvads.Run) -> rvads.Run:
    pose = np.array(run.pose)
    pose[..., 2] = np.degrees(pose[..., 2])
    return replace(run, pose=pose)


def mirrored(run: rvads.Run) -> rvads.Run:
    return replace(run, pose=run.pose * (1.0, -1.0, -1.0))


def further(run: rvads.Run) -> rvads.Run:
    way = np.stack((np.cos(run.pose[..., 2]), np.sin(run.pose[..., 2]), np.zeros_like(run.station)), axis=-1)
    return replace(run, station=run.station + 1.0, pose=run.pose + way)


def late_zones(run: rvads.Run) -> rvads.Run:
    return replace(run, zone=np.vstack((run.zone[:1], run.zone[:-1])))


def late_lights(run: rvads.Run) -> rvads.Run:
    return replace(run, lights=np.vstack((run.lights[:1], run.lights[:-1])))


def never_changing_lights(run: rvads.Run) -> rvads.Run:
    return replace(run, lights=np.repeat(run.lights[:1], run.steps, axis=0))


def sized(run: rvads.Run) -> rvads.Run:
    return replace(run, agents=tuple(replace(agent, size=(4.6, 1.86)) for agent in run.agents))


def another_pair(run: rvads.Run) -> rvads.Run:
    return replace(run, collisions=tuple(replace(c, agents=(c.agents[0], "a9")) for c in run.collisions or ()))


def unhit(run: rvads.Run) -> rvads.Run:
    """Nobody touches a pedestrian, and the run says that it took its whole time."""
    return replace(run, collisions=(), provenance=dict(run.provenance) | {"end": "duration"})


def late_walkers(run: rvads.Run) -> rvads.Run:
    """Pedestrians are a second late."""
    people = np.array([agent.kind is rvads.Kind.PEDESTRIAN for agent in run.agents])
    late = {}
    for name in ("zone", "station", "speed", "pose"):
        late[name] = getattr(run, name).copy()
        late[name][:, people] = np.concatenate((np.repeat(late[name][:1, people], 100, axis=0), late[name][:-100, people]))
    return replace(run, **late)


def late_collision(run: rvads.Run) -> rvads.Run:
    return replace(run, collisions=tuple(replace(c, time=c.time - 0.5) for c in run.collisions or ()))


def harder(run: rvads.Run) -> rvads.Run:
    return replace(run, collisions=tuple(replace(c, speed=3.6 * c.speed) for c in run.collisions or ()))


def central(run: rvads.Run) -> rvads.Run:
    """The pose is that of the middle of the body."""
    ahead = np.stack((np.cos(run.pose[..., 2]), np.sin(run.pose[..., 2]), np.zeros_like(run.station)), axis=-1)
    return replace(run, pose=run.pose - 2.3 * ahead)


def lost(run: rvads.Run) -> rvads.Run:
    pose = np.array(run.pose)
    pose[-1, 0] = np.nan
    return replace(run, pose=pose)


def in_km_h(run: rvads.Run) -> rvads.Run:
    return replace(run, speed=run.speed * 3.6)


def on_and_on(run: rvads.Run) -> rvads.Run:
    return rows(run, np.minimum(np.arange(run.steps + 50), run.steps - 1))


def saying(**told: Any) -> Callable[[rvads.Run], rvads.Run]:
    return lambda run: replace(run, provenance=dict(run.provenance) | told)


def swapped(case: rvads.Case) -> rvads.Case:
    return case if case.traffic is None else rvads.Case(case.scenario, case.traffic, case.driver, case.fleet)


def wider(case: rvads.Case) -> rvads.Case:
    width = case.fleet.vehicle.width
    return replace(case, fleet=rvads.Fleet(replace(case.fleet.vehicle, width=width + 1.0))) if width < 10.0 else case


def softer(case: rvads.Case) -> rvads.Case:
    return case.but(aggression=1) if case.scenario.aggression == 3 else case


def from_the_vertex(case: rvads.Case) -> rvads.Case:
    """Distances are taken for those to the entrance vertex."""
    scenario = case.scenario
    backs = scenario.place.setbacks
    return (
        case.but(distance=[max(d - back, 0.0) for d, back in zip(scenario.distances, backs, strict=True)]) if any(backs) else case
    )


def unturned_lights(run: rvads.Run) -> rvads.Run:
    plan = SignalPlan(run.junction.phase_groups)
    return replace(run, lights=np.array([plan.colours(float(time), run.lights.shape[1]) for time in run.times], dtype=np.int8))


def showing(change: Callable[[rvads.Observation], rvads.Observation]) -> Callable[[rvads.Case], rvads.Case]:
    """Return a change of a case: its driver is shown something else."""

    def before(case: rvads.Case) -> rvads.Case:
        class Misled:
            def __init__(self) -> None:
                self.driver: Any = case.driver()

            def control(self, seen: rvads.Observation) -> Any:
                return self.driver.control(change(seen))

        Misled.__qualname__ = getattr(case.driver, "__qualname__", "partial")
        return replace(case, driver=Misled)

    return before


class Counting(Wrapped):
    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        run = super().__call__(case, watch)
        return replace(run, station=run.station + self.runs * 1e-9)


class Remembering(Wrapped):
    """It drives another way when it has been at three junctions."""

    def __init__(self) -> None:
        super().__init__()
        self.places: set[str] = set()

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        run = super().__call__(case, watch)
        self.places.add(case.scenario.place.name)
        return replace(run, station=run.station + 1e-9) if len(self.places) > 2 else run


class Nameless(Wrapped):
    name = ""


class Padded(Wrapped):
    name = "wrapped\n"


class Proud(Wrapped):
    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return 2.0 * (super().vmax(distance, aggression, vehicle) or 0.0)


class Timid(Wrapped):
    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return 0.5 * (super().vmax(distance, aggression, vehicle) or 0.0)


class Confused(Wrapped):
    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return 5.0 / aggression


class Unbounded(Wrapped):
    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return float("nan")


class Careless(Wrapped):
    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        try:
            return super().__call__(case, watch)
        except rvads.errors.ScenarioError as error:
            raise ValueError(str(error)) from error


class Escaping(Wrapped):
    """What a driver raises gets out."""

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        run = super().__call__(case, watch)
        if run.fault is not None:
            raise RuntimeError("it raised")
        return run


class Unaware(Wrapped):
    """The limits of real time hold for no driver, because it asks them where nobody watches."""

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        return rvads.simulate(case, rvads.limits(0.0, 0.0, Inner()))


class Inner(Wrapped):
    pass


class Sticky(Wrapped):
    """Who is gone is not gone: the run ends where the first one is."""

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        run = super().__call__(case, watch)
        gone = (run.zone == rvads.Zone.GONE).any(axis=1)
        if not gone.any():
            return run
        return rows(run, slice(0, int(gone.argmax()) + 1))


class Forgiving(Wrapped):
    """Vehicles that leave their route are no reason to say so."""

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        run = super().__call__(case, watch)
        return replace(run, facts=replace(run.facts, strayed=()))


def unlimited(run: rvads.Run) -> rvads.Run:
    return replace(run, facts=replace(run.facts, speed_limit=13.9))


def without_others(seen: rvads.Observation) -> rvads.Observation:
    return seen._replace(others=seen.others[::-1])


def early(seen: rvads.Observation) -> rvads.Observation:
    return seen._replace(me=seen.me._replace(station=seen.me.station + 0.05))


WRONG: list[tuple[str, Any, str, str]] = [
    ("no name", Nameless(), "name", r"is called '', which is no name"),
    ("a name of two lines", Padded(), "name", r"the name must be one line without spaces around it, got 'wrapped\\n'"),
    (
        "an envelope that is too large",
        Proud(),
        "vmax",
        r"vmax\(30, aggression=1\) is 3\d\.\d+ m/s, expected at most 30 m/s",
    ),
    ("an envelope that shrinks", Confused(), "vmax", r"vmax\(0, aggression=3\) is 1\.667 m/s, less than with less distance"),
    (
        "an envelope that is no number",
        Unbounded(),
        "vmax",
        r"must give v\(d\)max as a speed of 0 m/s or more, or as None, got nan",
    ),
    (
        "vehicles that brake less than said",
        Proud(),
        "braking",
        r"from 1 x v\(d\)max = .* gets \+.* m past it, expected that it stops",
    ),
    (
        "vehicles that brake more than said",
        Timid(),
        "braking",
        r"from 1\.3 x v\(d\)max = .* gets -.* m past it, expected that it passes",
    ),
    ("another brake", Wrapped(before=softer), "braking", r"from 1 x v\(d\)max = .* gets \+.* m past it, expected that it stops"),
    (
        "starts a metre off",
        Wrapped(further),
        "starts",
        r"a0 starts at station -7\.00 m, expected -8\.00 m, 8 m before its stopping",
    ),
    (
        "lines that are not set back",
        Wrapped(before=from_the_vertex),
        "starts",
        r"a0 starts at station -8\.00 m, expected -11\.00 m, 8 m",
    ),
    (
        "lights that do not turn",
        Wrapped(unturned_lights),
        "lights",
        r"\.r3: the light of entrance 0 is green at 0\.00 s, expected red",
    ),
    ("speeds in km/h from the start", Wrapped(in_km_h), "starts", r"a0 starts at 14\.40 m/s, expected 4\.00 m/s"),
    (
        "left-handed coordinates",
        Wrapped(mirrored),
        "starts",
        r"a1 starts at \(.*\), expected \(.*\): give x and y of the front bumper",
    ),
    (
        "refuses as it likes",
        Careless(),
        "refusals",
        r"longer than the approach must be refused by a ScenarioError, got ValueError: ",
    ),
    (
        "a clock half as fast",
        Wrapped(slowly),
        "clock",
        r"at 0\.01 s the driver was shown station .* the run has .*: record the state",
    ),
    ("states left out", Wrapped(lambda run: rows(run, slice(0, None, 2))), "clock", r"51 states, expected 101 in 1 s"),
    ("another step", Wrapped(lambda run: replace(run, dt=0.02)), "clock", r"states are 0\.02 s apart, expected 0\.01 s"),
    ("states after the end", Wrapped(on_and_on), "ends", r"101 states, expected 51: a run of 0\.5 s ends at that time"),
    (
        "nobody says why it ended",
        Wrapped(saying(end=None)),
        "ends",
        r"says that it ended by None, expected 'duration' under 'end'",
    ),
    ("nobody watches who touches", Wrapped(lambda run: replace(run, collisions=None)), "integrity", r"its collisions are None"),
    ("places that are no numbers", Wrapped(lost), "integrity", r"pose of a0 at .* s is not a finite number: rvads\.validate"),
    ("no places", Wrapped(lambda run: replace(run, pose=None)), "integrity", r"its pose is None, expected an array of floats"),
    ("no states", Wrapped(lambda run: rows(run, slice(0, 0))), "clock", r"the run is empty: it has no states: rvads\.validate"),
    (
        "a driver of its own",
        Wrapped(before=lambda case: replace(case, driver=rvads.Reference)),
        "clock",
        r"asked 0 times in 1 s, expected",
    ),
    (
        "states that jump",
        Wrapped(back_from_gone),
        "gone",
        r"a0\+1 is gone at .* s and back at 30\.00 s, expected it to stay gone",
    ),
    ("zones a tick late", Wrapped(late_zones), "zones", r"a\d at station .* m is in zone approach at .* s, expected entrance"),
    (
        "speeds in km/h",
        Wrapped(in_km_h),
        "speeds",
        r"a0 gets on by 3\.0\d m/s from 0\.00 s to the next state, its speed is 10\.8\d",
    ),
    ("headings in degrees", Wrapped(degrees), "poses", r"has heading -?\d+\.\d+, its lane .* rad: counter-clockwise from east"),
    ("poses of another point", Wrapped(central), "poses", r"a0 at 0\.00 s has station -8\.00 m, its pose lies at -10\.30 m"),
    ("bodies of one size", Wrapped(sized), "bodies", r"the size of a0 is \(4\.6, 1\.86\), expected \(8\.0, 2\.4\)"),
    ("lights a tick late", Wrapped(late_lights), "lights", r"the light of entrance 0 is green at 15\.00 s, expected yellow"),
    ("lights that never change", Wrapped(never_changing_lights), "lights", r"the light of entrance 0 is green at 15\.00 s"),
    (
        "drivers see other lights",
        Wrapped(before=showing(lambda s: s._replace(lights=(rvads.Colour.RED,) * len(s.lights)))),
        "lights",
        r"the driver is shown that the light of entrance 0 is red at 0\.00 s, expected none",
    ),
    (
        "others in another order",
        Wrapped(before=showing(without_others)),
        "seen",
        r"a3 sees \['a2', 'a1', 'a0'\] at 0\.00 s, expected",
    ),
    (
        "drivers see the next state",
        Wrapped(before=showing(early)),
        "seen",
        r"a3 sees a3 at 0\.00 s at station .*: show all drivers",
    ),
    (
        "traffic drives the subject",
        Wrapped(before=swapped),
        "subject",
        r"a0 moves .* m in 1 s, where the subject a1 is to drive off",
    ),
    ("another speed limit", Wrapped(unlimited), "subject", r"its facts have the speed limit 13\.9, expected 11\.176 m/s"),
    (
        "faults swallowed",
        Wrapped(lambda run: replace(run, fault=None)),
        "faults",
        r"the driver Raises has a fault, the run has none",
    ),
    (
        "faults that get out",
        Escaping(),
        "faults",
        r"makes the simulator raise RuntimeError\('it raised'\), expected a run with Run\.fault",
    ),
    (
        "drivers that nobody watches",
        Unaware(),
        "hanging",
        r"a driver that hangs makes the simulator raise .*, expected a run with",
    ),
    (
        "routes that may be left",
        Forgiving(),
        "route",
        r"a0 steers off its route, its facts name \(\) as strayed, expected \('a0',\)",
    ),
    ("nothing after the first is gone", Sticky(), "gone", r"the run ends at .* s, expected 30 s: the others go on"),
    (
        "collisions not reported",
        Wrapped(lambda run: replace(run, collisions=())),
        "crossing",
        r"no collision of a0 and a1 is reported, (they are steered into each other|their bodies overlap)",
    ),
    (
        "another pair collides",
        Wrapped(another_pair),
        "crossing",
        r"the collisions name 'a9', which is none of the vehicles a0, a1",
    ),
    (
        "collisions half a second early",
        Wrapped(late_collision),
        "crossing",
        r"is said to be at .* s, their bodies .*: poses and sizes",
    ),
    (
        "nobody runs into anybody",
        Wrapped(lambda run: replace(run, collisions=())),
        "running_into",
        r"no collision of a0 and a0\+1 is reported, ",
    ),
    (
        "impacts in km/h",
        Wrapped(harder),
        "running_into",
        r"the collision is at 23\.\d+ m/s, the two move apart or together at 6\.",
    ),
    ("states after an impact", Wrapped(on_and_on), "running_into", r"the run goes on for 0\.5\d s after the collision"),
    ("pedestrians who are late", Wrapped(late_walkers), "pedestrians", r"p0 is at station .* its behaviour gives .* m"),
    ("pedestrians nobody hits", Wrapped(unhit), "pedestrians", r"no collision of a0 and p0 is reported, .* overlap from"),
    ("bodies that are too wide", Wrapped(before=wider), "passing", r"a0 and a2 are said to collide at .* they are .* m wide"),
    ("runs that are counted", Counting(), "repeatable", r"its hash is \w{12} and then \w{12}, expected the same"),
    ("runs that know the one before", Remembering(), "repeatable", r"its hash is \w{12}, after other cases \w{12}"),
    ("no versions", Wrapped(saying(versions={})), "provenance", r"its provenance has versions \{\}, expected \{'pytest-rvads'"),
    ("another name", Wrapped(saying(simulator="bullet")), "provenance", r"has simulator 'bullet', expected 'wrapped'"),
    ("what JSON can't hold", Wrapped(saying(extra={1, 2})), "provenance", r"its provenance can't be written as JSON"),
]


@pytest.mark.extended
@pytest.mark.parametrize(("simulator", "check", "message"), [pytest.param(*row[1:], id=row[0]) for row in WRONG])
def test_conformance_check_finds_its_fault(simulator: Any, check: str, message: str) -> None:
    sentences = faults(check, bench(simulator, longest=2.0 if check == "hanging" else 60.0))
    assert re.search(message, "\n".join(sentences))
    assert len(sentences) <= 3


@pytest.mark.extended
def test_wrapped_simulator_without_a_fault_passes() -> None:
    shared = bench(Wrapped())
    assert {check: found for check in CHECKS if check != "another_process" and (found := faults(check, shared))} == {}


def test_every_check_finds_a_fault() -> None:
    assert {check for _, _, check, _ in WRONG} | {"another_process"} == set(CHECKS)


OWN = """
import os
from dataclasses import replace
from pytest_rvads.simulators.loop import usual

class Mine:
    name = "mine"
    def __call__(self, case, watch=None):
        run = usual()(case, watch)
        return replace(run, station=run.station + JITTER)
    def vmax(self, distance, aggression=1, vehicle=None):
        return usual().vmax(distance, aggression, vehicle)
    def __reduce__(self):
        raise TypeError("it holds a connection")

mine = Mine()
"""


@pytest.mark.parametrize(
    ("jitter", "where", "message"),
    [
        ("0.0", "own_simulator:mine", "^$"),
        ("sum(watch.limits[:2]) * 1e-9", "own_simulator:mine", "^$"),  # whose runs may take as long there as here
        ("os.getpid() * 1e-9", "own_simulator:mine", r"its hash is \w{12}, in another process \w{12}: depend on the case"),
        ("0.0", None, r"can't be sent to another process, TypeError\('it holds a connection'\): name it by --rvads-simulator"),
        ("0.0", "own_simulator:yours", r"another process ended with status 1 and without its runs, .*'own_simulator:yours'"),
    ],
)
def test_another_process_finds_the_simulator_by_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jitter: str, where: str | None, message: str
) -> None:
    (tmp_path / "own_simulator.py").write_text(OWN.replace("JITTER", jitter), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_simulator", raising=False)
    sentences = faults("another_process", bench(named("own_simulator:mine"), "stop3", where=where))
    monkeypatch.delitem(sys.modules, "own_simulator")
    assert re.search(message, " ".join(sentences))


def test_error_raised_by_the_simulator_fails_the_check() -> None:
    def breaks(run: rvads.Run) -> rvads.Run:
        raise KeyError("no such actor")

    assert faults("clock", bench(Wrapped(breaks))) == ("the simulator raised KeyError: 'no such actor'",)


@pytest.mark.parametrize("check", ["crossing", "passing"])
def test_check_is_not_tried_where_no_junction_offers_it(check: str) -> None:
    with pytest.raises(NotTried, match=r"give one$"):
        faults(check, bench(USUAL, "roundabout4"))


def test_driver_whose_runs_end_by_faults_is_named() -> None:
    class Lazy:
        def control(self, seen: rvads.Observation) -> Any:
            return None

    (sentence,) = faults("speeds", bench(USUAL, drivers=[Lazy]))
    assert "the run ended by a fault at 0.00 s, expected none: " in sentence


@pytest.mark.parametrize(
    ("reasons", "message"),
    [
        ({"light": "none"}, r"unsupported names 'light', the checks are name, .*; did you mean 'lights'\?"),
        ({"clock": "slow"}, r"names 'clock', which no simulator can do without; it may do without bodies, lights, "),
        ({3: "none"}, r"unsupported names 3, the checks are name, "),
        ({"lights": " "}, r"unsupported needs a reason for 'lights', .*, got ' '"),
        (["lights"], r"unsupported takes reasons by the name of a check.*, got \['lights'\]"),
    ],
)
def test_unusable_attribute_unsupported_is_refused(reasons: Any, message: str) -> None:
    simulator = Wrapped()
    simulator.unsupported = reasons  # type: ignore[attr-defined]
    with pytest.raises(rvads.errors.ScenarioError, match=message):
        unsupported(simulator)


def test_object_that_is_no_simulator_fails_the_check_of_its_name() -> None:
    (sentence,) = faults("name", bench(Nameless()))
    assert sentence.startswith("simulator <")


DARK = """
from dataclasses import replace
import numpy as np
from pytest_rvads.simulators.loop import usual

class Dark:
    name = "dark"
    unsupported = {"lights": "its lights can't be set", "bodies": "bodies are those of its blueprints"}
    def __call__(self, case, watch=None):
        run = usual()(case, watch)
        lights = np.repeat(run.lights[:1], run.steps, axis=0)
        return replace(run, lights=lights, provenance={**run.provenance, "simulator": self.name})
    def vmax(self, distance, aggression=1, vehicle=None):
        return usual().vmax(distance, aggression, vehicle)

dark = Dark()
"""


@pytest.mark.extended
def test_unsupported_check_is_expected_to_fail_and_fails_when_it_passes(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(own_dark=DARK)
    result = pytester.runpytest_subprocess(
        *("-p", "no:cacheprovider", "--pyargs", "pytest_rvads.satellites.conformance", "--rvads-simulator", "own_dark:dark"),
        *("-k", "name or lights or bodies", "-rxf"),
    )
    result.assert_outcomes(passed=1, failed=1, xfailed=1, deselected=len(CHECKS) - 3)
    result.stdout.fnmatch_lines(["XFAIL *lights* - its lights can't be set", "FAILED *bodies* - *XPASS(strict)*"])
