"""What the paper publishes about its tables, and how many cells a table without any mechanism would get right.

Verdicts are those of Li, Sifakis, Wang, Yan, Zhang: Simulation-based Validation for Autonomous Driving Systems (ISSTA
2023). Classes 1 and 3 stand in its tables; what is known here of classes 2 and 4 is what its text says about them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

from pytest_rvads.paper.experiment import LIGHT, ROWS, STOP, Key

__all__ = ["FITTED", "agreement", "null_models", "published"]

FITTED = (1, 3)
"""Classes that the constants were fitted on."""

_WORDS = {"F": "FAIL", "P": "PASS", "-": "NA"}
# Per configuration the rules of the table; four letters stand for the rows, one for all of them.
_CLASS_1 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "FFPF F -", "E": "FFPF F P"}
_CLASS_2 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "? F -", "E": "? F P"}
_CLASS_3 = {"F": "F - F", "G": "P - F", "H": "P - F", "I": "P - F", "J": "P - F"}
_CLASS_4 = {"F": "- P -", "G": "- P -", "H": "- - -", "I": "- - -", "J": "- F -"}
_CLASSES = {1: (STOP, _CLASS_1), 2: (STOP, _CLASS_2), 3: (LIGHT, _CLASS_3), 4: (LIGHT, _CLASS_4)}


def published(numbers: tuple[int, ...] = (1, 2, 3, 4)) -> dict[Key, str]:
    """Return what the paper says about the cells of classes `numbers`; a cell it does not tell is left out."""
    found: dict[Key, str] = {}
    for number in numbers:
        table, says = _CLASSES[number]
        for letter, text in says.items():
            for rule, word in zip(table.rules, text.split(), strict=True):
                for row in range(ROWS):
                    mark = word[row] if len(word) == ROWS else word
                    if mark != "?":
                        found[number, row, letter, rule] = _WORDS[mark]
    return found


def agreement(verdicts: Mapping[Key, str], numbers: tuple[int, ...]) -> tuple[int, int]:
    """Return how many cells of classes `numbers` are as published, and how many are published."""
    wanted = published(numbers)
    return sum(verdicts[key] == value for key, value in wanted.items()), len(wanted)


def null_models() -> dict[str, int]:
    """Return how many of the cells of classes 1 and 3 a table would get that knows less than a simulation.

    Each model answers with the most frequent verdict among the cells it cannot tell apart, so its count is the best
    that it could reach.
    """
    models: dict[str, Callable[[Key], object]] = {
        "one verdict for everything": lambda _: None,
        "by rule": lambda key: key[3],
        "by rule and configuration": lambda key: key[2:],
        "by rule, configuration and row": lambda key: key[1:],
    }
    wanted = published(FITTED)
    score = {}
    for name, group in models.items():
        seen: dict[object, Counter[str]] = {}
        for key, value in wanted.items():
            seen.setdefault(group(key), Counter())[value] += 1
        score[name] = sum(max(counter.values()) for counter in seen.values())
    return score
