"""Small pieces of SVG: escaped text, polylines, documents."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pytest_rvads.wording import markup

__all__ = ["document", "polyline", "text", "wrap"]


def document(width: float, height: float, body: Iterable[str], defs: str = "") -> str:
    """Return an SVG document with a white background; `width` and `height` in pixels."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}" '
        f'font-family="sans-serif" font-size="12"><defs>{defs}</defs>'
        f'<rect width="100%" height="100%" fill="white"/>{"".join(body)}</svg>\n'
    )


def polyline(points: Iterable[Sequence[float]], **style: str | float) -> str:
    """Return an open line through `points`; underscores in the names of style attributes become hyphens."""
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path d="M{path}" fill="none"{_attributes(style)}/>'


def text(x: float, y: float, content: str, **style: str | float) -> str:
    """Return a line of text at a point, escaped."""
    return f'<text x="{x:.1f}" y="{y:.1f}"{_attributes(style)}>{markup(content)}</text>'


def wrap(content: str, width: int) -> list[str]:
    """Break text into lines of at most `width` characters, long words too."""
    lines = [""]
    for word in content.split():
        for part in (word[i : i + width] for i in range(0, len(word), width)):
            if lines[-1] and len(lines[-1]) + 1 + len(part) > width:
                lines.append(part)
            else:
                lines[-1] = f"{lines[-1]} {part}".strip()
    return lines


def _attributes(style: dict[str, str | float]) -> str:
    return "".join(f' {name.replace("_", "-")}="{markup(str(value))}"' for name, value in style.items())
