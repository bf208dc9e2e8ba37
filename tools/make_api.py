"""Write docs/api.md, the reference of every public name, from the docstrings: ``python tools/make_api.py``."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from enum import Enum
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, get_origin

import pytest_rvads
from pytest_rvads.support.lazy import homes

PAGE = Path(__file__).parents[1] / "docs" / "api.md"
HEAD = """# Public names

Written by `python tools/make_api.py` from the docstrings. All names are in `pytest_rvads`, which is imported as `rvads`."""
_PROPERTIES = (property, cached_property)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the page."""
    names: list[str] = pytest_rvads.__all__
    parts = [HEAD, " · ".join(f"[{name}](#{name.lower()})" for name in names)]
    return "\n\n".join([*parts, *(_entry(name, getattr(pytest_rvads, name)) for name in names)]) + "\n"


def _entry(name: str, thing: Any) -> str:
    parts = [f"## {name}"]
    if isinstance(thing, ModuleType):
        public = [(f"{name}.{n}", getattr(thing, n)) for n in thing.__all__ if not n.startswith("_")]
        return "\n\n".join([*parts, _prose(inspect.getdoc(thing)), *(part for each in public for part in _of_module(*each))])
    if inspect.isclass(thing) and issubclass(thing, Enum):
        parts += [_prose(inspect.getdoc(thing)), "One of " + ", ".join(f"`{member.name}`" for member in thing) + "."]
    elif get_origin(thing):
        parts += [f"`{_shown(str(thing))}`", _prose(_below(name))]
    elif inspect.isclass(thing):
        parts += [_code(name, thing), _prose(inspect.getdoc(thing)), *_fields(thing), *_methods(name, thing)]
    elif inspect.isroutine(thing):
        parts += [_code(name, thing), _prose(inspect.getdoc(thing))]
    else:  # a callable value has the docstring of its class, whose arguments have been given
        parts += [_code(name, thing), _prose((inspect.getdoc(thing) or "").partition("\nArgs:\n")[0])]
    return "\n\n".join(part for part in parts if part)


def _of_module(name: str, value: Any) -> list[str]:
    """Return what there is to say of a public name of a module that is a public name itself."""
    if inspect.isclass(value) and issubclass(value, Enum):
        return [f"**`{name}`**", f"{_prose(inspect.getdoc(value))} One of {', '.join(f'`{member.value}`' for member in value)}."]
    told = [_member(name, value)]
    return [*told, *_fields(value), *_methods(name, value)] if inspect.isclass(value) else told


def _methods(name: str, cls: type) -> list[str]:
    found = []
    for key, value in vars(cls).items():
        if not key.startswith("_") and (
            inspect.isfunction(value) or isinstance(value, (*_PROPERTIES, classmethod, staticmethod))
        ):
            found.append(_member(f"{name}.{key}", value))
    return [part for part in found if part]


def _member(name: str, value: Any) -> str:
    doc = inspect.getdoc(value)
    if not doc:
        return ""
    inner = getattr(value, "__func__", value)
    shown = f"`{name}`" if isinstance(value, _PROPERTIES) else f"`{name}{_signature(inner)}`"
    return f"**{shown}**\n\n{_prose(doc)}"


def _fields(cls: type) -> list[str]:
    """Return the documented fields of a class: annotated names followed by a string."""
    try:
        body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    except (OSError, TypeError):
        return []
    rows = []
    statements = body.body if isinstance(body, ast.ClassDef) else []
    for this, after in zip(statements, [*statements[1:], None], strict=True):
        if isinstance(this, ast.AnnAssign) and isinstance(this.target, ast.Name) and not this.target.id.startswith("_"):
            told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
            text = " ".join(inspect.cleandoc(str(after.value.value)).split()) if told else ""  # type: ignore[union-attr]
            rows.append(f"| `{this.target.id}` | `{_cell(ast.unparse(this.annotation))}` | {_cell(text)} |")
    return ["\n".join(["| field | type | |", "|---|---|---|", *rows])] if rows else []


def _below(name: str) -> str:
    """Return the string below the line that defines an alias of a type."""
    module = inspect.getsource(import_module(homes("pytest_rvads")[name]))
    told = re.search(rf'^{name} = .*\n"""([^"]*)"""', module, re.MULTILINE)
    return told[1] if told else ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _code(name: str, thing: Any) -> str:
    signature = _signature(thing)
    return f"```text\n{name}{signature}\n```" if signature else ""


def _signature(thing: Any) -> str:
    if getattr(thing, "_is_protocol", False):
        return ""
    try:
        text = str(inspect.signature(thing))
    except (TypeError, ValueError):
        return ""
    for public in pytest_rvads.__all__:  # a default that is a public value is called by its name, not by its address
        text = text.replace(object.__repr__(getattr(pytest_rvads, public)), public)
    return _shown(text)


def _shown(text: str) -> str:
    text = re.sub(r"ForwardRef\(([^()]*)\)", r"\1", text)
    text = re.sub(r"<(?:function|class|built-in function) ['\"]?([\w.]+)[^>]*>", r"\1", text)
    return re.sub(r"pytest_rvads\.(?:\w+\.)*(\w+)", r"\1", text).replace("'", "")


def _prose(doc: str | None) -> str:
    """Return a docstring as Markdown: sections of arguments as lists."""
    lines, section = [], ""
    for line in (doc or "").replace("``", "`").splitlines():
        if found := re.fullmatch(r"(Args|Returns|Raises|Yields|Attributes):", line):
            section = found[1]
            lines += ["", f"*{section}*", ""]
        elif section in ("Args", "Raises", "Attributes") and (found := re.fullmatch(r"    ([\w*]+): (.*)", line)):
            lines.append(f"- `{found[1]}`: {found[2]}")
        elif line and not line.startswith("    "):
            section = ""
            lines.append(line)
        else:
            lines.append(f"  {line.strip()}".rstrip() if section in ("Args", "Raises", "Attributes") else line.strip())
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip()


if __name__ == "__main__":
    main()
