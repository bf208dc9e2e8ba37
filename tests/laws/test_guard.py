"""No formula is left to run: random formulas of size 15 are answered or refused, and quickly."""

import random
import time

import pytest

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import synthesize
from pytest_rvads.support.errors import FormulaError

UNARY = (f.Not, f.Next, f.Always, f.Eventually)
BINARY = (f.Until, f.WeakUntil, f.Release, f.Implies, f.Iff)


def made(size: int, chance: random.Random, names: str) -> f.Formula:
    if size == 1:
        return f.Atom(chance.choice(names))
    if size == 2 or chance.random() < 0.3:
        return chance.choice(UNARY)(made(size - 1, chance, names))
    left = chance.randint(1, size - 2)
    parts = made(left, chance, names), made(size - 1 - left, chance, names)
    kind = chance.randrange(7)
    return f.And(parts) if kind == 5 else f.Or(parts) if kind == 6 else BINARY[kind](*parts)


def slowest(count: int, seed: int) -> tuple[float, list[str]]:
    """Return the longest time [s] and the refusals over random formulas with 2 to 8 propositions."""
    chance = random.Random(seed)
    worst, refused = 0.0, []
    for k in range(count):
        formula = made(15, chance, "abcdefgh"[: 2 + k % 7])
        start = time.process_time()
        try:
            synthesize.__wrapped__(formula)
        except FormulaError as error:
            refused.append(str(error))
        worst = max(worst, time.process_time() - start)
    return worst, refused


def test_random_formulas_are_answered_quickly() -> None:
    worst, refused = slowest(300, 1)
    assert worst < 1.0
    assert len(refused) <= 3, "nearly all of them are answered"


@pytest.mark.slow
def test_ten_thousand_random_formulas_are_answered_quickly() -> None:
    worst, refused = slowest(10_000, 2)
    assert worst < 1.0
    assert len(refused) <= 50
    assert all("of size 1" in message for message in refused)
