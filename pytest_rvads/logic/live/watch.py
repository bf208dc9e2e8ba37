"""Monitors that are stepped only if an atom that they read has changed, or if they have not settled yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

from pytest_rvads.logic.judging.prepare import Template
from pytest_rvads.logic.ltl.boolean import holds
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth

__all__ = ["Fact", "Reading", "Watch"]


class Fact:
    """The present value of a ground atom, with the watches that read the atom.

    Args:
        value: the value at creation.
        ask: computes the value; None if `tell` is called at every change.
    """

    __slots__ = ("ask", "homes", "value", "watches")

    def __init__(self, value: bool, ask: Callable[[], bool] | None = None) -> None:
        self.value, self.ask = value, ask
        self.watches: list[tuple[Watch, int]] = []
        self.homes: list[Callable[[], None]] = []
        """Callables that end the computation of the atom once no watch reads the atom."""

    def tell(self, value: bool) -> None:
        """Set the present value, and wake the watches if the value has changed."""
        if value is not self.value:
            self.value = value
            for watch, bit in self.watches:
                watch.mask ^= bit
                watch.wake()

    def leave(self, watch: Watch) -> bool:
        """Remove a watch, and return whether no watch is left."""
        self.watches = [entry for entry in self.watches if entry[0] is not watch]
        if not self.watches:
            for end in self.homes:
                end()
        return not self.watches


class Reading:
    """Maps the truth values of a machine's atoms, given as a mask with bit k for atom k, to letters.

    Args:
        machine: the machine, over propositions p0, p1, ...
        asked: numbers of the atoms that are evaluated only if they affect the letter.
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
        """Return the letter if all values of the atoms in `asked` give the same letter, else None."""
        try:
            return self._letters[mask]
        except KeyError:
            certain = mask & ~sum(self._bits)
            choices = product(*((0, bit) for bit in self._bits))
            letters = {self.exact(certain | sum(choice)) for choice in choices} if len(self._bits) <= _MOST_ASKED else set()
            letter = self._letters[mask] = letters.pop() if len(letters) == 1 else None
            return letter

    def exact(self, mask: int) -> int:
        """Return the letter for the values of all atoms."""
        letter = self._exact.get(mask)
        if letter is None:
            machine = self._machine
            true = frozenset(a for a in machine.atoms if mask >> int(a.name[1:]) & 1)
            code = sum(1 << k for k, guard in enumerate(machine.guards) if holds(guard, true))
            letter = self._exact[mask] = machine.letter(code)
        return letter

    def can_fail(self, state: int, false: int) -> bool:
        """Return whether a violation is reachable from a state while the atoms of mask `false` stay false."""
        reachable = self._hopeless.get((state, false))
        if reachable is None:
            count = len(self._machine.atoms)
            free = [1 << k for k in range(count) if not false >> k & 1]
            reachable = self._hopeless[state, false] = len(free) > _MOST_FREE or self._reaches(state, free)
        return reachable

    def _reaches(self, state: int, free: Sequence[int]) -> bool:
        letters = {self.exact(sum(choice)) for choice in product(*((0, bit) for bit in free))}
        states, pending = {state}, [state]
        while pending:
            row = self.delta[pending.pop()]
            after = {row[letter] for letter in letters} - states
            states |= after
            pending += after
        return any(self.output[s] is Truth.FALSE for s in states)


_MOST_FREE = 8
"""Most atoms whose values are all tried to decide whether a violation is reachable."""
_MOST_ASKED = 6
"""Most atoms whose values are all tried to decide whether the atoms affect the letter."""


class Watch:
    """The monitor of one instance.

    Args:
        rule: number of the rule.
        template: the instance.
        reading: the reading of its machine.
        facts: the facts that its propositions stand for.
        queue: the queue of watches to step, to which the watch appends itself.
        state: the state of the machine.
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
        """The present verdict."""
        return self.reading.output[self.state]

    def wake(self) -> None:
        """Enter the queue, to be stepped in this instant."""
        if not self._queued:
            self._queued = True
            self._queue.append(self)

    def step(self) -> Truth:
        """Read the letter of this instant; enter the queue again unless the same letter read again would change nothing."""
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
        """Return whether the instance can still be violated while these facts stay false."""
        return self.reading.can_fail(self.state, sum(1 << k for k, fact in enumerate(self.facts) if fact in false))

    def end(self) -> None:
        """Remove the watch from its facts."""
        for fact in dict.fromkeys(self.facts):
            fact.leave(self)
