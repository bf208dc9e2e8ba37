"""What damages files and messages: changes of a good one, drawn by Hypothesis; see `LONG` for how to look longer."""

import json
import os
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

__all__ = ["LONG", "QUICK", "damaged", "hostile_json", "hostile_text"]

LONG = int(os.environ.get("RVADS_FUZZ", "1"))
"""``RVADS_FUZZ=100 pytest tests/fuzz`` draws a hundred times as many examples, and other ones in every session."""
QUICK = settings(
    derandomize=LONG == 1,
    deadline=None,
    max_examples=100 * LONG,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
)
_TEXTS = [
    *(
        "",
        " ",
        "\x00",
        "\x1b[2J",
        "\ud800",
        "\u202e",
        "=1+1",
        "@x",
        "<script>alert(1)</script>",
        "javascript:alert(1)",
        "a" * 5000,
    ),
    *("../../etc/passwd", "nan", "1e999", "-1", "constructor", "__proto__", '"', "'", "&amp;", "]]>", "{}", "%s", "\n"),
]
_NUMBERS = [0, -1, 1, 2**31, 2**63, 2**64, 10**400, -(10**400), 0.5, 1e308, float("nan"), float("inf"), -0.0]
hostile_text = st.sampled_from(_TEXTS) | st.text(max_size=20)
"""Texts that mean something to somebody: terminals, browsers, spreadsheets, file systems, encoders."""
_scalars = st.none() | st.booleans() | st.sampled_from(_NUMBERS) | st.integers() | st.floats() | hostile_text
hostile_json = st.recursive(
    _scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(hostile_text, inner, max_size=3)
)
"""Values of JSON, with the numbers that Python reads though JSON has none."""


@st.composite
def damaged(draw: st.DrawFn, seed: bytes) -> bytes:
    """Draw a file with some bytes changed, cut or repeated; where it is JSON, also one with some values replaced."""
    try:
        content = json.loads(seed)
    except ValueError:
        content = None
    if content is not None and draw(st.booleans()):
        for _ in range(draw(st.integers(1, 3))):
            content = _replaced(draw, content)
        return json.dumps(content).encode("utf-8", "surrogatepass")
    data = bytearray(seed)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(data)))
        length = draw(st.integers(0, 40) | st.just(len(data)))
        piece = draw(
            st.binary(max_size=8) | st.sampled_from([data[:200], data[-200:], *(t.encode("utf-8", "replace") for t in _TEXTS)])
        )
        data[at : at + length] = piece
    return bytes(data)


def _replaced(draw: st.DrawFn, value: Any) -> Any:
    """Return a value of JSON in which one somewhere inside is another one, missing, or there twice."""
    if isinstance(value, dict | list) and value and draw(st.integers(0, 9)):
        key = draw(st.sampled_from(sorted(value) if isinstance(value, dict) else range(len(value))))
        copy: Any = value.copy()
        if draw(st.integers(0, 9)):
            copy[key] = _replaced(draw, value[key])
        elif draw(st.booleans()):
            del copy[key]
        elif isinstance(copy, list):
            copy.insert(key, copy[key])
        else:
            copy[draw(hostile_text)] = copy[key]
        return copy
    return draw(hostile_json)
