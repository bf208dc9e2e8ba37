"""Self-contained pages: one frame, with a policy by which a browser runs their own script and nothing that came with the data."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from hashlib import sha256
from importlib.resources import files
from string import Template
from typing import Any

from pytest_rvads.support.wording import markup, printable

__all__ = ["webpage"]

_FRAME = Template("""\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="$policy">
<meta name="viewport" content="width=device-width">
<title>$title</title>
<link rel="icon" href="data:,">
<style>$style</style>
$body
<script type="application/json" id="data">$data</script>
<script>$script</script>
</html>
""")
_POLICY = Template(
    "default-src 'none'; script-src 'sha256-$script'; style-src 'sha256-$style'; img-src data:; "
    "base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'; trusted-types 'none'"
)


def webpage(sources: Sequence[tuple[str, str]], title: str, data: object, style: str = "", **parts: str) -> str:
    """Return an HTML page.

    Args:
        sources: package and name of the sources of the page, then of the part within the page, if there is one. ``NAME.html`` is
            the body, with a ``$place`` for each part of `parts`, and ``$part`` for the next source; ``NAME.css`` and ``NAME.js``,
            which need not exist, are its style and script. All scripts follow the common script ``webpage.js``.
        title: the title of the page.
        data: what the script finds in the element ``data``, as JSON; it has to show texts as texts.
        style: further style, before that of the sources.
        parts: markup, in which what is not ours went through `markup`.
    """
    body, script = "", _read("pytest_rvads.report", "webpage.js")
    for package, name in reversed(sources):
        body = Template(_read(package, f"{name}.html")).substitute(parts, part=body)
    for package, name in sources:
        style += _read(package, f"{name}.css")
        script += _read(package, f"{name}.js")
    return _FRAME.substitute(
        policy=_POLICY.substitute(script=_digest(script), style=_digest(style)),
        title=markup(title),
        style=style,
        body=body,
        # "<" could end the script element from inside a string.
        data=json.dumps(_shown(data), separators=(",", ":")).replace("<", "\\u003c"),
        script=script,
    )


def _read(package: str, name: str) -> str:
    """Return a source of a page; empty if there is no such file."""
    file = files(package).joinpath(name)
    return file.read_text(encoding="utf-8") if file.is_file() else ""


def _shown(value: Any) -> Any:
    """Return a value of JSON whose texts can be shown."""
    if isinstance(value, str):
        return printable(value, len(value))
    if isinstance(value, dict):
        return {key: _shown(inner) for key, inner in value.items()}
    return list(map(_shown, value)) if isinstance(value, list | tuple) else value


def _digest(text: str) -> str:
    return b64encode(sha256(text.encode()).digest()).decode()
