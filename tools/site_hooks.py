"""What `mkdocs build` adds to the pages of docs/: links that leave the folder, and pages and replays made at build time."""

from __future__ import annotations

import io
import os
import posixpath
import re
import subprocess
import sys
import tempfile
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from pytest_rvads.cli import main
from pytest_rvads.session.options import all_options

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parents[1]
COPIED = ("ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
"""Pages beside docs/ that the site has too."""
_LINK = re.compile(r"(\]\()([^)\s]+)(\))")
_CODE = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
_OPTIONS = """\
# Options

Options of pytest that begin with `--rvads-`. Each option has a twin in the ini file, for example in `pyproject.toml`:

```toml
[tool.pytest.ini_options]
rvads_map = "maps/town.xodr"
rvads_cover = "scenario"
```

The command line comes before an environment variable, and that before the ini file."""
_REPLAY = re.compile(r"^<!-- replay: ([\w-]+) -->$", re.MULTILINE)


def on_files(files: Files, config: Any) -> Files:
    """Add what does not lie in docs/: pages beside it, pages made from the code, replays of the gallery."""
    from mkdocs.structure.files import File  # here, so that all else can be tested where there is no mkdocs

    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in COPIED}
    texts |= {"options.md": options(), "commands.md": commands()}
    for name, text in {**texts, **gallery()}.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Return the text of a page as the site needs it."""
    source = page.file.src_uri
    known = {file.src_uri for file in files}
    return framed(piped(linked(markdown, source, known, config["repo_url"])))


def linked(markdown: str, source: str, known: set[str], repository: str) -> str:
    """Return a text in which links to files that the site does not have lead to the repository."""
    folder = "" if source in COPIED else posixpath.join("docs", posixpath.dirname(source))

    def target(found: re.Match[str]) -> str:
        path, mark, anchor = found[2].partition("#")
        if not path or "://" in path or path.startswith("mailto:"):
            return found[0]
        inside = posixpath.normpath(posixpath.join(folder, path))
        place = inside.removeprefix("docs/") if inside.startswith("docs/") else inside if inside in COPIED else ""
        if place in known:
            path = posixpath.relpath(place, posixpath.dirname(source) or ".")
        elif (ROOT / inside).exists():
            path = f"{repository}/{'tree' if (ROOT / inside).is_dir() else 'blob'}/main/{inside}"
        return f"{found[1]}{path}{mark}{anchor}{found[3]}"

    parts = _CODE.split(markdown)
    return "".join(part if k % 2 else _LINK.sub(target, part) for k, part in enumerate(parts))


def piped(markdown: str) -> str:
    r"""Return a text without ``\|`` in the code of tables: GitHub needs the backslash there, Python-Markdown shows it."""
    lines = [
        re.sub(r"`[^`]*`", lambda code: code[0].replace(r"\|", "|"), line) if line.startswith("|") else line
        for line in markdown.split("\n")
    ]
    return "\n".join(lines)


def framed(markdown: str) -> str:
    """Return a text in which the comments that name a replay are frames that show it, from two seconds before the failure on."""

    def frame(found: re.Match[str]) -> str:
        time = max(float(re.findall(r" at t=([\d.]+) s", markdown[: found.start()])[-1]) - 2.0, 0.0)
        page = f"gallery/{found[1]}.html#t={time:.2f}"
        return (
            f'<iframe class="replay" src="{page}" title="replay: {found[1]}" loading="lazy"></iframe>\n\n'
            f'<a href="{page}">Open this replay as a page of its own</a>'
        )

    return _REPLAY.sub(frame, markdown)


def gallery() -> dict[str, str]:
    """Return the replay pages of the gallery by where they stand, made by `tools/make_gallery.py` from its tests."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, str(ROOT / "tools" / "make_gallery.py"), folder], check=True, stdout=subprocess.DEVNULL)
        return {f"gallery/{path.name}": path.read_text(encoding="utf-8") for path in sorted(Path(folder).glob("*.html"))}


def options() -> str:
    """Return the page of all options."""
    sections = []
    for action in all_options()._actions:
        found = re.fullmatch(r"(.*?)(?: \((?:ini: \w+)?(?:, )?(?:default ([^()]+))?\))?", str(action.help).replace("%%", "%"))
        text, default = found.groups() if found else ("", None)
        value = "|".join(action.choices) if action.choices else action.metavar
        held = f"default `{default}`" if default else "no default"
        told = re.sub(r"\bdocs/([\w-]+\.md)", r"[\1](\1)", f"{text[0].upper()}{text[1:]}.")
        flag = action.option_strings[0]
        sections.append(f"## {flag}\n\n`{flag}={value}`, in the ini file `{action.dest}`, {held}\n\n{told}")
    return "\n\n".join([_OPTIONS, *sections]) + "\n"


def commands() -> str:
    """Return the page of all commands: what each prints with ``--help``."""
    parts = ["# Commands", "What `rvads --help` prints, and below it the help of each command.", f"```text\n{_help()}```"]
    for name in _named(_help()):
        parts += [f"## rvads {name}", f"```text\n{_help(name)}```"]
        for inner in _below(_help(name)):
            parts += [f"### rvads {name} {inner}", f"```text\n{_help(name, inner)}```"]
    return "\n\n".join(parts) + "\n"


def _named(told: str) -> list[str]:
    """Return the commands that the help of ``rvads`` explains, and those that it names as further ones."""
    explained = re.findall(r"^  ([a-z][\w-]*) ", told, re.MULTILINE)
    further = re.search(r"^further commands: ([^(]+)", told, re.MULTILINE)
    return [*explained, *(re.findall(r"[\w-]+", further[1]) if further else [])]


def _below(told: str) -> list[str]:
    """Return the commands that a help text lists."""
    listed = re.search(r"^positional arguments:\n  [A-Z]+\n((?:    .*\n)+)", told, re.MULTILINE)
    return re.findall(r"^    ([\w-]+)", listed[1], re.MULTILINE) if listed else []


def _help(*words: str) -> str:
    told = io.StringIO()
    with redirect_stdout(told), patch.dict(os.environ, COLUMNS="100", NO_COLOR="1"), suppress(SystemExit):
        main([*words, "--help"])
    return told.getvalue()
