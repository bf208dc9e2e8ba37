"""The abilities of a driver: the required method, the optional attributes, and a check for misspelt attributes.

A driver need not derive from `rvads.Autopilot`: any object with the methods is a driver. So that ``periode = 0.05`` is not
ignored silently, an attribute is refused if its name is similar to an ability and its value has the type of that ability.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from inspect import getattr_static
from numbers import Real
from typing import Any

from pytest_rvads.support.errors import AutopilotError

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
"""Abilities of a driver of one vehicle, with a check of the value of each ability; `rvads.Autopilot` describes the abilities."""
OF_SYSTEMS: Mapping[str, Callable[[Any], bool]] = {"autopilots": _method, "label": _word}
"""Abilities of what coordinates the autopilots of a run, see `rvads.TrafficSystem`."""
_ALIKE = 0.8
"""Least similarity (ratio of `difflib`) of a name and an ability for a misspelling; ``lable`` and ``label`` reach it."""


def check_factory(factory: Any) -> None:
    """Check that an object is a factory of autopilots.

    Raises:
        AutopilotError: the object can't be called.
    """
    if not callable(factory):
        raise AutopilotError(
            f"an autopilot must be a class or a callable that makes one, got {factory!r}: every vehicle of every run "
            "gets a new one, so pass the class, not an instance"
            + ("; rvads.traffic(name) returns a traffic policy" if isinstance(factory, str) else "")
        )


def spelling(driver: Any, abilities: Mapping[str, Callable[[Any], bool]], base: type) -> str:
    """Return the error of a wrong label, or a question about a misspelt attribute, or an empty text.

    Args:
        driver: an autopilot or a traffic system.
        abilities: the abilities of such an object.
        base: the class with the default attributes: an ability inherited from `base` does not count as defined.
    """
    label = getattr(driver, "label", None)
    if not (label is None or isinstance(label, str) or callable(label)):
        return f"its label must be a text, got an object of type {type(label).__name__}"
    defaults = vars(base)
    own = {name for name in abilities if hasattr(driver, name) and getattr_static(driver, name, None) is not defaults.get(name)}
    return _question(dir(driver), lambda name: getattr_static(driver, name, None), abilities, own)


def refuse(cls: type, abilities: Mapping[str, Callable[[Any], bool]]) -> None:
    """Raise where what the body of a class defines is misspelt for one of `abilities`.

    Raises:
        AutopilotError: it is.
    """
    question = _question(vars(cls), vars(cls).get, abilities, abilities.keys() & vars(cls).keys())
    if question:
        raise AutopilotError(f"class {cls.__qualname__} {question}")


def _question(
    names: Iterable[str], look: Callable[[str], Any], abilities: Mapping[str, Callable[[Any], bool]], own: Iterable[str]
) -> str:
    """Return a question about the first of `names` that is probably a misspelt ability, or an empty text.

    A name is no misspelling if it is a longer word (``controller``), begins differently (``aiming``, ``_period``), names a class
    (``Timing``), or if the driver defines the ability as well. A name with the same letters in another order or with a capital is
    a misspelling whatever its value.
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
