"""What the plugin asks of a driver: one method that it must have, the rest if it likes; and what is misspelt for one of them.

Nobody has to derive from `rvads.Autopilot`: any object that has the methods will do. The price would be that ``periode = 0.05``
says nothing; so an attribute that nearly spells an ability, and is of its sort, is refused.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from inspect import getattr_static
from numbers import Real
from typing import Any

from pytest_rvads.errors import AutopilotError

__all__ = ["OF_AUTOPILOTS", "OF_SYSTEMS", "check_factory", "refuse", "spelling"]


def _number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _word(value: Any) -> bool:
    return isinstance(value, str)


def _method(value: Any) -> bool:
    return callable(value) or isinstance(value, staticmethod | classmethod)


OF_AUTOPILOTS: Mapping[str, Callable[[Any], bool]] = {
    "control": _method,
    "period": _number,
    "label": _word,
    "timing": _method,
    "abandon": _method,
}
"""Abilities of what drives one vehicle, and of what sort each is; `rvads.Autopilot` says what they are for."""
OF_SYSTEMS: Mapping[str, Callable[[Any], bool]] = {"autopilots": _method, "label": _word}
"""Abilities of what coordinates the autopilots of a run, see `rvads.TrafficSystem`."""
_ALIKE = 0.8
"""How alike two names are of which one is taken for the other misspelt, see `difflib`; ``lable`` is that near to ``label``."""


def check_factory(what: Any) -> None:
    """Raise where something is nothing that can make autopilots.

    Raises:
        AutopilotError: it can't be called.
    """
    if not callable(what):
        raise AutopilotError(
            f"an autopilot must be a class or a callable that makes one, got {what!r}: every vehicle of every run "
            "gets a new one, so pass the class, not an instance"
            + ("; rvads.traffic(name) returns a traffic policy" if isinstance(what, str) else "")
        )


def spelling(made: Any, abilities: Mapping[str, Callable[[Any], bool]], base: type) -> str:
    """Return what is wrong with a label, or a question about an attribute that is misspelt for one of `abilities`, or nothing.

    Args:
        made: an autopilot or a traffic system.
        abilities: those that it can have.
        base: the class whose attributes are defaults: an ability inherited from there is not one of its own.
    """
    label = getattr(made, "label", None)
    if not (label is None or isinstance(label, str) or callable(label)):
        return f"its label must be a text, got an object of type {type(label).__name__}"
    defaults = vars(base)
    own = {name for name in abilities if hasattr(made, name) and getattr_static(made, name, None) is not defaults.get(name)}
    return _question(dir(made), lambda name: getattr_static(made, name, None), abilities, own)


def refuse(made: type, abilities: Mapping[str, Callable[[Any], bool]]) -> None:
    """Raise where what the body of a class defines is misspelt for one of `abilities`.

    Raises:
        AutopilotError: it is.
    """
    question = _question(vars(made), vars(made).get, abilities, abilities.keys() & vars(made).keys())
    if question:
        raise AutopilotError(f"class {made.__qualname__} {question}")


def _question(
    names: Iterable[str], look: Callable[[str], Any], abilities: Mapping[str, Callable[[Any], bool]], own: Iterable[str]
) -> str:
    """Return a question about the first of `names` that is no ability but nearly one, and of its sort; or nothing.

    A word that goes on for letters, as ``controller``, or begins otherwise, as ``aiming`` or ``_period``, is another word. So is
    one beside the ability itself, which nobody misspells who has it, and what names a class, as ``Timing``. The same letters in
    another order, or with a capital, are no word at all, whatever the value.
    """
    missing = {name: sort for name, sort in abilities.items() if name not in own}
    for name in names:
        if name in abilities:
            continue
        small = name[:1].lower() + name[1:]
        for ability, sort in missing.items():
            if small[:1] != ability[0] or abs(len(small) - len(ability)) > 1:
                continue
            if difflib.SequenceMatcher(None, small, ability).ratio() >= _ALIKE:
                value = look(name)
                fits = isinstance(value, property) or sort(value) or sorted(small) == sorted(ability)
                if fits and not isinstance(value, type):
                    return f"has {name!r}: is it misspelt for {ability!r}? Spell it so, or give it another name"
    return ""
