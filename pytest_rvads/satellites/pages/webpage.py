"""Makes self-contained HTML pages from templates; the content security policy lets a browser run only the page's script."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from pytest_rvads.logic.outcome import MARKS
from pytest_rvads.support.wording import printable


def webpage(template: str, title: str, data: object, sources: Sequence[str], *, style: str = "", **content: Any) -> str:
    """Return an HTML page made of a template that extends ``frame.html``; style sheets and scripts are files of this package."""
    light, dark = ("".join(f"--{mark}:{look[number]};" for mark, look in MARKS.items()) for number in (1, 2))
    colours = f":root{{{light}}}@media screen{{:root[data-theme=dark]{{{dark}}}}}"
    style = colours + "".join(_source(name) for name in sources if name.endswith(".css")) + style
    script = "".join(_source(name) for name in ("webpage.js", *sources) if name.endswith(".js"))
    policy = (
        f"default-src 'none'; script-src 'sha256-{_digest(script)}'; style-src 'sha256-{_digest(style)}'; img-src data:; "
        "base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
    )
    # "<" could end the script element from inside a string.
    text = json.dumps(_printable_data(data), separators=(",", ":")).replace("<", "\\u003c")
    frame = {"policy": policy, "style": Markup(style), "script": Markup(script), "data": Markup(text)}
    return _templates().get_template(template).render(title=title, **frame, **content)


@cache
def _templates() -> Environment:
    return Environment(
        loader=PackageLoader("pytest_rvads.satellites", "pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: printable(value, len(value)) if type(value) is str else value,
    )


def _source(name: str) -> str:
    return files("pytest_rvads.satellites.pages").joinpath(name).read_text(encoding="utf-8")


def _printable_data(value: Any) -> Any:
    """Return a JSON value with the control characters in its texts escaped."""
    if isinstance(value, str):
        return printable(value, len(value))
    if isinstance(value, dict):
        return {key: _printable_data(inner) for key, inner in value.items()}
    return list(map(_printable_data, value)) if isinstance(value, list | tuple) else value


def _digest(text: str) -> str:
    return b64encode(sha256(text.encode()).digest()).decode()
