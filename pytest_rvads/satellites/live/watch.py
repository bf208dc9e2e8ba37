"""Monitors that read a state only if an atom has changed, or if reading the same truth values again changes the monitor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

from pytest_rvads.logic.judging.instances import Template
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, holds


class Fact:
    """The present truth value of an atom, with its watches (monitors); `ask` is None if `tell` is called at every change."""

    __slots__ = ("ask", "homes", "value", "watches")

    def __init__(self, value: bool, ask: Callable[[], bool] | None = None) -> None:
        self.value, self.ask = value, ask
        self.watches: list[tuple[Watch, int]] = []
        self.homes: list[Callable[[], object]] = []
        """Functions that are called once no watch reads the atom any more, and end the computation of the atom."""

    def tell(self, value: bool) -> None:
        """Set the present truth value; if it has changed, make the watches (monitors) of the atom read the present state."""
        if value is not self.value:
            self.value = value
            for watch, bit in self.watches:
                watch.mask ^= bit
                watch.wake()

    def leave(self, watch: Watch) -> bool:
        """Remove a watch (monitor) from the atom, and return whether no watch of the atom is left."""
        self.watches = [entry for entry in self.watches if entry[0] is not watch]
        if not self.watches:
            for end in self.homes:
                end()
        return not self.watches


class Reading:
    """Maps the truth values of a monitor's atoms (a mask with bit k for atom k) to letters, the inputs of the monitor.

    The atoms in `asked` are evaluated only if their values affect the letter.
    """

    def __init__(self, machine: Machine, asked: Sequence[int]) -> None:
        self.delta: list[list[int]] = machine.delta.tolist()
        self.output: list[Truth] = [Truth(v) for v in machine.output.tolist()]
        self._machine = machine
        self._bits = [1 << k for k in asked]
        self._letters: dict[int, int | None] = {}
        self._exact: dict[int, int] = {}
        self._hopeless: dict[tuple[int, int], bool] = {}

    def letter(self, mask: int) -> int | None:
        """Return the letter (input of the monitor) if the letter is the same for all values of the atoms in `asked`, or None."""
        try:
            return self._letters[mask]
        except KeyError:
            certain = mask & ~sum(self._bits)
            choices = product(*((0, bit) for bit in self._bits))
            letters = {self.exact(certain | sum(choice)) for choice in choices} if len(self._bits) <= _MOST_ASKED else set()
            letter = self._letters[mask] = letters.pop() if len(letters) == 1 else None
            return letter

    def exact(self, mask: int) -> int:
        """Return the letter (input of the monitor) for given values of all atoms."""
        letter = self._exact.get(mask)
        if letter is None:
            machine = self._machine
            true = frozenset(a for a in machine.atoms if mask >> int(a.name[1:]) & 1)
            code = sum(1 << k for k, guard in enumerate(machine.guards) if holds(guard, true))
            letter = self._exact[mask] = machine.letter(code)
        return letter

    def can_fail(self, state: int, false: int) -> bool:
        """Return whether a monitor in a state can still reach a violation while the atoms of mask `false` stay false."""
        reachable = self._hopeless.get((state, false))
        if reachable is None:
            count = len(self._machine.atoms)
            free = [1 << k for k in range(count) if not false >> k & 1]
            reachable = len(free) > _MOST_FREE
            if not reachable:
                letters = {self.exact(sum(choice)) for choice in product(*((0, bit) for bit in free))}
                states, pending = {state}, [state]
                while pending:
                    row = self.delta[pending.pop()]
                    after = {row[letter] for letter in letters} - states
                    states |= after
                    pending += after
                reachable = any(self.output[s] is Truth.FALSE for s in states)
            self._hopeless[state, false] = reachable
        return reachable


_MOST_FREE = 8
"""Largest number of atoms of which all combinations of values are tried to decide whether a violation is reachable."""
_MOST_ASKED = 6
"""Largest number of atoms of which all combinations of values are tried to decide whether the atoms affect the letter."""


class Watch:
    """The monitor of an instance of a rule: the propositions p0, p1, ... of its machine stand for `facts`.

    A watch that has to read the present state appends itself to `queue`.
    """

    __slots__ = ("_queue", "_queued", "asked", "facts", "mask", "reading", "rule", "state", "template")

    def __init__(
        self, rule: int, template: Template, reading: Reading, facts: Sequence[Fact], queue: list[Watch], state: int = 0
    ) -> None:
        self.rule, self.template, self.reading, self.state = rule, template, reading, state
        self.facts = tuple(facts)
        self._queue, self._queued = queue, False
        self.mask = 0
        self.asked = [(1 << k, fact.ask) for k, fact in enumerate(facts) if fact.ask is not None]
        for k, fact in enumerate(facts):
            if fact.ask is None:
                self.mask |= fact.value << k
                fact.watches.append((self, 1 << k))
            else:
                fact.watches.append((self, 0))
        self.wake()

    @property
    def verdict(self) -> Truth:
        """The verdict after the states that the monitor has read."""
        return self.reading.output[self.state]

    def wake(self) -> None:
        """Put this monitor into the queue of the monitors that have to read the present state."""
        if not self._queued:
            self._queued = True
            self._queue.append(self)

    def step(self) -> Truth:
        """Read the present state and return the verdict.

        The monitor puts itself into the queue for the next state if reading the same truth values again would change its state.
        """
        self._queued = False
        reading = self.reading
        letter = reading.letter(self.mask)
        asked = letter is None
        if letter is None:
            mask = self.mask
            for bit, ask in self.asked:
                if ask is not None and ask():
                    mask |= bit
            letter = reading.exact(mask)
        row = reading.delta[self.state]
        self.state = row[letter]
        verdict = reading.output[self.state]
        if verdict is Truth.UNKNOWN and (asked or reading.delta[self.state][letter] != self.state):
            self.wake()
        return verdict

    def can_fail(self, false: frozenset[Fact]) -> bool:
        """Return whether the instance can still be violated while the facts in `false` stay false."""
        return self.reading.can_fail(self.state, sum(1 << k for k, fact in enumerate(self.facts) if fact in false))

    def end(self) -> None:
        """Remove this monitor from the atoms that it reads."""
        for fact in dict.fromkeys(self.facts):
            fact.leave(self)
