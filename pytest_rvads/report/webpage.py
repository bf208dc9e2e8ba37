"""Makes self-contained HTML pages in a common frame; the content security policy lets a browser run only the page's script."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from hashlib import sha256
from importlib.resources import files
from string import Template
from typing import Any

from pytest_rvads.support.wording import markup, printable

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
    """Return an HTML page."""
    body, script = "", _source_text("pytest_rvads.report", "webpage.js")
    for package, name in reversed(sources):
        body = Template(_source_text(package, f"{name}.html")).substitute(parts, part=body)
    for package, name in sources:
        style += _source_text(package, f"{name}.css")
        script += _source_text(package, f"{name}.js")
    return _FRAME.substitute(
        policy=_POLICY.substitute(script=_digest(script), style=_digest(style)),
        title=markup(title),
        style=style,
        body=body,
        # "<" could end the script element from inside a string.
        data=json.dumps(_printable_data(data), separators=(",", ":")).replace("<", "\\u003c"),
        script=script,
    )


def _source_text(package: str, name: str) -> str:
    """Return the content of a source file of a page; empty if the file does not exist."""
    file = files(package).joinpath(name)
    return file.read_text(encoding="utf-8") if file.is_file() else ""


def _printable_data(value: Any) -> Any:
    """Return a JSON value with the control characters in its texts escaped."""
    if isinstance(value, str):
        return printable(value, len(value))
    if isinstance(value, dict):
        return {key: _printable_data(inner) for key, inner in value.items()}
    return list(map(_printable_data, value)) if isinstance(value, list | tuple) else value


def _digest(text: str) -> str:
    return b64encode(sha256(text.encode()).digest()).decode()
