"""Self-contained pages: one frame, with a policy by which a browser runs their own script and nothing that came with the data."""

from __future__ import annotations

import json
from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
from string import Template
from typing import Any

from pytest_rvads.wording import markup, printable

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


def webpage(package: str, name: str, title: str, data: object, style: str = "", **parts: str) -> str:
    """Return an HTML page.

    Args:
        package: where its sources lie: ``NAME.html``, the body, with a ``$place`` for each part; ``NAME.css``, ``NAME.js``, which
            begins with what all scripts share (``webpage.js``).
        name: of the sources.
        title: of the page.
        data: what the script finds in the element ``data``, as JSON; it has to show texts as texts.
        style: further style.
        parts: markup, in which what is not ours went through `markup`.
    """
    body, own, script = (files(package).joinpath(f"{name}.{kind}").read_text(encoding="utf-8") for kind in ("html", "css", "js"))
    script = files("pytest_rvads").joinpath("webpage.js").read_text(encoding="utf-8") + script
    return _FRAME.substitute(
        policy=_POLICY.substitute(script=_digest(script), style=_digest(style + own)),
        title=markup(title),
        style=style + own,
        body=Template(body).substitute(parts),
        # "<" could end the script element from inside a string.
        data=json.dumps(_shown(data), separators=(",", ":")).replace("<", "\\u003c"),
        script=script,
    )


def _shown(value: Any) -> Any:
    """Return a value of JSON whose texts can be shown."""
    if isinstance(value, str):
        return printable(value, len(value))
    if isinstance(value, dict):
        return {key: _shown(inner) for key, inner in value.items()}
    return list(map(_shown, value)) if isinstance(value, list | tuple) else value


def _digest(text: str) -> str:
    return b64encode(sha256(text.encode()).digest()).decode()
