"""What is the case now: the ground atoms that live monitors look at, each worked out once for all rules, and only as needed.

Zones, waiting times and lights are looked at when they change, signals in every state. Other words, users' words among them, are
worked out on a run of one state, where a monitor asks for them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, TypeVar

from pytest_rvads.conduct.blocks import Signal
from pytest_rvads.conduct.cast import Cast
from pytest_rvads.conduct.instant import Instant
from pytest_rvads.conduct.mover import Mover
from pytest_rvads.logic.judging.evaluate import OPERATORS, Values
from pytest_rvads.logic.live.ground_atoms import element_of, in_columns, key_of
from pytest_rvads.logic.live.watch import Fact
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, word_of
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.rules.vocabulary import Follower
from pytest_rvads.runs.states import APPROACH, ENTRANCE, EXIT, JUNCTION

__all__ = ["Board"]

_Entry = TypeVar("_Entry")
_Test = Callable[[], bool]


class Board:
    """The facts of one instant after the other.

    Args:
        now: the instant, which goes on.
    """

    def __init__(self, now: Instant) -> None:
        self.now = now
        self._facts: dict[object, Fact] = {}
        self._places: dict[Mover, list[tuple[Fact, frozenset[int]]]] = {}
        self._waits: dict[Mover, list[tuple[Fact, _Test]]] = {}
        self._crossings: set[int] = set()
        """Waiting times at which a comparison of two of them may change [ticks]."""
        self._colours: list[tuple[Fact, _Test]] = []
        self._signals: dict[Signal[Any], list[tuple[Fact, tuple[Mover, ...]]]] = {}
        self._columns: dict[Signal[Any], list[tuple[Fact, int]]] = {}
        self._cast: Cast | None = None
        self._rows: dict[Signal[Any], list[bool]] = {}
        """Of every signal the state before."""
        self._followed: list[tuple[Fact, Follower]] = []
        self._bodily: dict[Mover, set[Fact]] = {}
        self._ends: dict[Mover, list[Callable[[], None]]] = {}
        self._lights: list[int] = []

    def drop(self, mover: Mover) -> None:
        """Forget a vehicle about which no monitor is left."""
        for end in self._ends.pop(mover, ()):
            end()
        for known in (self._places, self._waits, self._bodily):
            known.pop(mover, None)
        for key in [key for key, fact in self._facts.items() if not fact.watches]:
            del self._facts[key]

    def bodily(self, movers: Iterable[Mover]) -> frozenset[Fact]:
        """Return the facts that are false as long as one of these vehicles is absent."""
        return frozenset(fact for mover in movers for fact in self._bodily.get(mover, ()))

    def read(self, changed: Sequence[Mover]) -> None:
        """Bring all facts up to this instant.

        Args:
            changed: whose zone is another one than before.

        Raises:
            RunError: something is not given that an atom asks for.
        """
        now = self.now
        self._read_changes(changed)
        if now.block.cast is not self._cast:
            self._cast = now.block.cast
            self._columns.clear()
            self._rows.clear()
        for signal in self._signals:
            row = signal(now.block)[-1].tolist()
            if row != self._rows.get(signal):
                self._rows[signal] = row
                for fact, column in self._columns_of(signal):
                    fact.tell(row[column])
        for fact, follow in self._followed:
            fact.tell(bool(follow(now.run)))

    def _read_changes(self, changed: Sequence[Mover]) -> None:
        """Tell what hangs on zones, waiting times and lights."""
        now, crossings = self.now, self._crossings
        for mover in changed:
            for fact, zones in self._places.get(mover, ()):
                fact.tell(mover.zone in zones)
        for mover, waits in self._waits.items():
            if mover in changed or mover.arrived_at == now.tick or mover.wt in crossings or now.waited(mover) in crossings:
                for fact, test in waits:
                    fact.tell(test())
        if now.lights != self._lights:
            self._lights = now.lights
            for fact, test in self._colours:
                fact.tell(test())

    def _forget(self, key: object) -> None:
        self._facts.pop(key, None)

    def fact(self, atom: f.Atom, movers: Sequence[Mover], tie: float) -> Fact:
        """Return a ground atom as it is now, and follow it.

        Args:
            atom: speaks of agents by their place in `movers`.
            movers: the vehicles.
            tie: waiting times that differ by at most this count as equal [s].

        Raises:
            RunError: something is not given that it asks for.
        """
        key = (atom.word or atom.name, tuple(key_of(term, movers) for term in atom.terms), tie if atom.name in OPERATORS else 0.0)
        found = self._facts.get(key)
        if found is None:
            agents = [movers[e.index] for e in map(element_of, atom.terms) if e is not None and e.sort == Sort.AGENT]
            found = self._quick(atom, agents, tie) or self._general(atom, movers, tie)
            self._facts[key] = found
            word = word_of(atom)
            if word is not None and word.present:
                for mover in agents:
                    self._bodily.setdefault(mover, set()).add(found)
            found.homes.append(partial(self._forget, key))
        return found

    def _quick(self, atom: f.Atom, agents: Sequence[Mover], tie: float) -> Fact | None:
        """Return a fact that is told when it changes, None where this is no word of ours that can be followed so."""
        now = self.now
        word = word_of(atom)
        if word is not None and isinstance(word.holds, Signal):
            return self._of_signal(word.holds, agents)
        if atom.word is not None:
            return None
        match atom.name, atom.terms:
            case "@", (_, f.Element() as place) if agents:
                zones = self._zones(place)
                fact = Fact(agents[0].zone in zones)
                return self._keep(fact, self._places.setdefault(agents[0], []), (fact, zones))
            case (("<" | "<=" | "=" | "!=" | ">" | ">="), (f.Attr(_, "wt"), f.Attr(_, "wt"))):
                return self._wait(atom.name, agents, tie, lambda mover: mover.wt)
            case (("<" | "<=" | "=" | "!=" | ">" | ">="), (f.Attr(_, "waited"), f.Attr(_, "waited"))):
                return self._wait(atom.name, agents, tie, now.waited)
            case (("=" | "!="), (f.Attr(f.Element(Sort.LIGHT, number), "cl"), f.Value(name))):
                return self._colour(number, name, equal=atom.name == "=")
        return None

    def _of_signal(self, signal: Signal[Any], agents: Sequence[Mover]) -> Fact:
        """Return a fact that is one column of a signal."""
        fact = Fact(bool(signal(self.now.block, *(mover.slot for mover in agents))[-1]))
        self._columns.pop(signal, None)
        return self._keep(fact, self._signals.setdefault(signal, []), (fact, tuple(agents)))

    def _columns_of(self, signal: Signal[Any]) -> list[tuple[Fact, int]]:
        """Return the facts about a signal, and which column of the signal each of them is."""
        cast, facts, columns = self.now.block.cast, self._signals[signal], self._columns.get(signal)
        if columns is None or len(columns) != len(facts):
            found = ((fact, signal.column(cast, [mover.slot for mover in movers])) for fact, movers in facts)
            columns = self._columns[signal] = [(fact, column) for fact, column in found if column is not None]
        return columns

    def _general(self, atom: f.Atom, movers: Sequence[Mover], tie: float) -> Fact:
        """Return a fact that is worked out on a run of one state."""
        now, moved, word = self.now, in_columns(atom, movers), word_of(atom)
        if word is not None and word.follow is not None:
            follow = word.follow(now.run, *word.arguments(moved))
            fact = Fact(bool(follow(now.run)))
            return self._keep(fact, self._followed, (fact, follow), *movers)
        return Fact(False, lambda: bool(Values(now.run, tie)[moved][0]))

    def _zones(self, place: f.Element) -> frozenset[int]:
        """Return the zones that a vehicle is in when it is at a place of its own way."""
        if place.sort == Sort.JUNCTION:
            return frozenset((int(JUNCTION),))
        if place.sort == Sort.ENTRANCE:
            return frozenset((int(ENTRANCE),))
        approach = place.sort == Sort.ROAD and place.index < len(self.now.junction.entrances)
        return frozenset((int(APPROACH), int(ENTRANCE)) if approach else (int(EXIT),))

    def _wait(self, sign: str, pair: Sequence[Mover], tie: float, waited: Callable[[Mover], int]) -> Fact:
        compare, window, (one, two) = OPERATORS[sign], round(tie / self.now.dt), pair

        def test() -> bool:
            longer = waited(one) - waited(two)
            return bool(compare(0 if -window <= longer <= window else longer, 0))

        fact = Fact(test())
        self._crossings.add(window + 1)
        for mover in pair:
            self._keep(fact, self._waits.setdefault(mover, []), (fact, test))
        return fact

    def _colour(self, light: int, name: str, *, equal: bool) -> Fact | None:
        codes = ATTRIBUTES["cl"].codes
        if codes is None:
            return None
        now, wanted = self.now, codes(name)
        self._lights = now.lights
        fact = Fact((now.lights[light] == wanted) is equal)
        return self._keep(fact, self._colours, (fact, lambda: (now.lights[light] == wanted) is equal))

    def _keep(self, fact: Fact, where: list[_Entry], entry: _Entry, *until: Mover) -> Fact:
        """Have a fact looked after in a list, as long as somebody looks at it, or until one of these vehicles is dropped."""
        where.append(entry)

        def end() -> None:
            if entry in where:
                where.remove(entry)

        if until:
            for mover in until:
                self._ends.setdefault(mover, []).append(end)
        else:
            fact.homes.append(end)
        return fact
