"""Signals have the same values whether a run is fed as one block or in many blocks, and whoever is there meanwhile."""

from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic import conduct
from pytest_rvads.logic.conduct.blocks import Block, Signal, as_blocks, signal
from pytest_rvads.logic.conduct.bodies import overlap
from pytest_rvads.logic.conduct.priority import brakes_hard, obstructs, owes, unhindered
from pytest_rvads.logic.conduct.rights import close_behind, held, kept_by, kept_by_walker, next_to_go, starting, waives
from pytest_rvads.logic.conduct.standing import advance, entered, facing, leads, stands, waited, wt
from pytest_rvads.logic.conduct.stretches import claims
from pytest_rvads.logic.conduct.waiting import (
    Circles,
    Lost,
    blocks,
    circles,
    idles,
    lets_pass,
    lets_walk,
    losses,
    may_go,
    no_room,
)
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import zones
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.runs.states import Agent, Colour, Kind, Zone
from pytest_rvads.satellites.live.instant import Stream

from ..zebras import zebra

STEPS, COUNT, DT = 240, 8, 0.1
SEEDS = {"stop4": 85, "light4": 85, "yield4": 85, "zebra": 1}
"""Of the traffic at built-in junctions, and at `light4` with crosswalks, chosen so that every signal changes in it."""


def part_of(whole: Signal[Any], name: str) -> Signal[Any]:
    """Return one array of a signal that is a tuple of arrays."""

    def work(block: Block) -> Any:
        return getattr(whole(block), name)

    work.__name__ = f"{whole.work.__name__}.{name}"
    return signal(work)


def signals_of_modules() -> list[Signal[Any]]:
    """Return all signals that the modules of `conduct` hold."""
    modules = [import_module(f"{conduct.__name__}.{module.name}") for module in iter_modules(conduct.__path__)]
    return list(dict.fromkeys(value for module in modules for value in vars(module).values() if isinstance(value, Signal)))


CARRIED = tuple(signal for signal in signals_of_modules() if signal.start)
WORDS = tuple(word.holds for word in BUILT_IN.values() if isinstance(word.holds, Signal) and word.holds is not idles)
"""Nobody idles in traffic as short as this; the parts of `losses`, by which `idles` is decided, change."""
SIGNALS: tuple[Signal[Any], ...] = tuple(
    dict.fromkeys(
        (
            *WORDS,
            wt,
            facing,
            advance,
            starting,
            waives,
            kept_by,
            kept_by_walker,
            brakes_hard,
            no_room,
            *(part_of(losses, name) for name in Lost._fields),
            stands,
            leads,
            waited,
            held,
            next_to_go,
            close_behind,
            unhindered,
            overlap,
            lets_pass,
            lets_walk,
            claims,
            *(part_of(circles, name) for name in Circles._fields),
        )
    )
)
PLACES = tuple(SEEDS)


@cache
def traffic(place: str) -> Run:
    """Return vehicles that appear, drive, stand, back off and vanish by chance, and lights that change by chance."""
    junction = zebra("light4", lit=True).walked if place == "zebra" else find(place)
    rng = np.random.default_rng(SEEDS[place])
    ways, shape = sorted(junction.movements), (STEPS, COUNT)
    walked = sorted(further.way.key for further in junction.further if isinstance(further.way, Crossing))
    zone, station, speed = np.full(shape, Zone.ABSENT, dtype=np.int8), np.full(shape, np.nan), np.full(shape, np.nan)
    pose = np.full((*shape, 3), np.nan)
    agents = []
    for k, begin in enumerate(rng.integers(0, STEPS // 2, COUNT).tolist()):
        on_foot = place == "zebra" and k % 2 == 1
        way = itinerary(junction, *(walked[k // 2] if on_foot else ways[rng.integers(len(ways))]))
        paces = [0.0, 0.05, -0.5, 1.5, 1.5, 1.5] if on_foot else [0.0, 0.05, -0.5, 2.0, 2.0, 5.0]
        speeds = np.repeat(rng.choice(paces, 100), rng.integers(3, 25, 100))[: STEPS - begin]
        along = way.line - rng.uniform(-2.0, 14.0) + np.concatenate(([0.0], np.cumsum(speeds[:-1]) * DT))
        here = slice(begin, begin + int(rng.integers(50, STEPS - begin + 1)))
        along = along[: here.stop - begin]
        zone[here, k], station[here, k], speed[here, k] = zones(way.borders, along), along, speeds[: len(along)]
        aside = 4.0 * np.sin(along / 6.0) * (k % 3 == 0)
        lines = np.array([way.pose(float(s)) for s in along])
        pose[here, k] = lines + np.column_stack((-aside * np.sin(lines[:, 2]), aside * np.cos(lines[:, 2]), 0.0 * aside))
        kind, size = (Kind.PEDESTRIAN, (0.6, 0.6)) if on_foot else (Kind.CAR, (float(rng.choice([4.6, 10.0])), 1.8))
        agents.append(Agent(f"v{k}", junction.every_way[way.entrance, way.exit], kind, size))
    colours = rng.choice([Colour.GREEN, Colour.YELLOW, Colour.RED], (STEPS // 20, len(junction.starts)))
    lights = np.repeat(colours, 20, axis=0).astype(np.int8)
    return Run("t", junction, tuple(agents), zone, lights, DT, station, speed, pose, facts=Facts(speed_limit=4.0))


def fed(run: Run, size: int, carried: Sequence[Signal[Any]] = CARRIED) -> Iterator[tuple[Sequence[int], slice, Block]]:
    """Yield a run in blocks of at most `size` states, each with the columns of those who are there in all of its states.

    The signals `carried` are worked out on every block.
    """
    stream = Stream(run.junction, run.dt, run.facts)
    present = run.zone != Zone.ABSENT
    columns: list[int] | None = None
    begin = 0
    while begin < run.steps:
        there = np.flatnonzero(present[begin]).tolist()
        same = (present[begin : begin + size] == present[begin]).all(axis=1)
        part = slice(begin, begin + (len(same) if same.all() else int(same.argmin())))
        if there != columns:
            before = {column: place for place, column in enumerate(columns or ())}
            stream.recast([run.agents[k] for k in there], [before.get(k) for k in there])
            columns = there
        arrays = {name: run.need(name)[part][:, there] for name in ("station", "speed", "pose")}
        yield there, part, stream.feed(carried, run.zone[part][:, there], run.lights[part], **arrays)
        begin = part.stop


def alone(run: Run, signal: Signal[Any], there: Sequence[int], part: slice, block: Block) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the values of a signal on the whole run, and on a block, about those who are there."""
    names = (
        [(k,) for k in range(len(there))]
        if signal.pairs is None
        else [(one, two) for one in range(len(there)) for two in range(len(there)) if one != two]
    )
    if not names:
        return np.empty(0), np.empty(0)
    whole = np.stack([signal(run, *(there[k] for k in name))[part] for name in names])
    return whole, np.stack([signal(block, *name) for name in names])


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("place", PLACES)
def test_signals_of_blocks_are_those_of_the_whole_run(place: str, size: int) -> None:
    run = traffic(place)
    for there, part, block in fed(run, size):
        for quantity in SIGNALS:
            whole, parts = alone(run, quantity, there, part, block)
            assert np.array_equal(whole, parts, equal_nan=whole.dtype == np.float64), (quantity.work.__name__, part)


@pytest.mark.parametrize("word", [owes, obstructs, idles, blocks, may_go], ids=lambda word: word.work.__name__)
@pytest.mark.parametrize("place", PLACES)
def test_word_alone_in_blocks_of_one_state_equals_the_whole_run(place: str, word: Signal[Any]) -> None:
    """As in a live monitor of one rule, nothing but the word is asked for, in blocks of one state."""
    run = traffic(place)
    for there, part, block in fed(run, 1, [entered, word]):
        whole, parts = alone(run, word, there, part, block)
        assert np.array_equal(whole, parts), part


def test_late_first_request_of_a_signal_with_a_carry_is_refused() -> None:
    run = traffic("stop4")
    stream = Stream(run.junction, run.dt, run.facts)
    stream.recast(run.agents, [None] * len(run.agents))
    states = [stream.feed([], run.zone[k : k + 1], run.lights[k : k + 1]) for k in range(2)]
    with pytest.raises(RuntimeError, match="wt depends on earlier states"):
        wt(states[1])


@pytest.mark.parametrize("quantity", SIGNALS, ids=lambda quantity: quantity.work.__name__)
def test_every_signal_changes_in_this_traffic(quantity: Signal[Any]) -> None:
    """What the test above compares is not the same everywhere."""
    values = [np.asarray(quantity(traffic(place))) for place in PLACES]
    assert any(len(np.unique(value[np.isfinite(value)])) > 1 for value in values)


def test_many_vehicles_that_are_always_present_are_read_in_blocks() -> None:
    """A signal on 200 pairs of vehicles in 100,000 states is 160 MB; the states are read in parts, and no state is left out."""
    junction = find("stop4")
    agents = tuple(Agent(f"v{k}", junction.movements[0, 2]) for k in range(15))
    steps = 100_000
    run = Run("t", junction, agents, np.zeros((steps, 15), dtype=np.int8), np.zeros((steps, 4), dtype=np.int8))
    parts = as_blocks(run)
    assert max(len(part.zone) for part in parts) * 200 * 8 < 10e6
    assert [part.tick for part in parts] == np.cumsum([0, *(len(part.zone) for part in parts[:-1])]).tolist()
    assert sum(len(part.zone) for part in parts) == steps
