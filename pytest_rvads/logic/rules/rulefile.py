"""Files of rules, in the form of an INI file with one section per rule.

Example::

    [gives_way]
    text = forall a, j.en. G(a@j.en -> F a@j)
    title = nobody waits forever
    requirement = REQ-7
"""

from __future__ import annotations

from configparser import ConfigParser
from configparser import Error as IniError
from pathlib import Path
from typing import Any

from pytest_rvads.logic.rules.book import rule
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.support.errors import FormulaError, suggest
from pytest_rvads.support.storage import read_file

__all__ = ["load_rules"]

_MOST_BYTES, _MOST_RULES = 2**20, 1000
_KEYS = ("text", "title", "meaning", "source", "responsible", "bound", "about", "tie", "requirement")


def load_rules(path: str | Path) -> tuple[Rule, ...]:
    """Register every rule of a file and return the rules in order.

    Args:
        path: the file. Its keys are the arguments of `rule`; ``text`` is required and may extend over several indented lines.

    Raises:
        FormulaError: the file can't be read or holds too many rules, a key is unknown, or a rule has no text or a wrong text.
    """
    path = Path(path)
    parser = ConfigParser(interpolation=None, comment_prefixes=("#", ";"), default_section="")
    try:
        parser.read_string(read_file(path, _MOST_BYTES).decode(), source=str(path))
    except OSError as error:
        raise FormulaError(f"{path}: can't be read: {error.strerror}") from error
    except (IniError, UnicodeDecodeError) as error:
        raise FormulaError(f"{path}: not a file of rules: {' '.join(str(error).split())}") from error
    if len(parser.sections()) > _MOST_RULES:
        raise FormulaError(f"{path}: {len(parser.sections()):,} rules, at most {_MOST_RULES:,} are read: split it into files")
    rules = []
    for name in parser.sections():
        section = dict(parser.items(name))
        for key in section:
            if key not in _KEYS:
                raise FormulaError(
                    f"{path}: rule {name!r}: unknown key {key!r}{suggest(key, _KEYS)}; known are {', '.join(_KEYS)}"
                )
        if not section.get("text"):
            raise FormulaError(f"{path}: rule {name!r} has no text: add `text = ` and a formula")
        try:
            rules.append(_rule(name, section, path))
        except FormulaError as error:
            raise FormulaError(f"{path}: {error}") from None
    return tuple(rules)


def _rule(name: str, section: dict[str, str], path: Path) -> Rule:
    properties: dict[str, Any] = {key: value for key, value in section.items() if key != "text"}
    try:
        properties["tie"] = float(section.get("tie", "0"))
    except ValueError:
        raise FormulaError(f"rule {name!r}: tie must be a number of seconds, got {section['tie']!r}") from None
    properties["bound"] = section.get("bound", "").replace(",", " ").split()
    return rule(name, section["text"], **properties, place=f"{path}, section [{name}]")
