"""The commands ``rvads init``, which writes the first test files of a project, and ``rvads docs``, which needs no network."""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from pydoc import pager
from string import Template

import pytest_rvads
from pytest_rvads.cli.common import MAP_FORMATS, Subparsers, conflicting, say, share
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.support.errors import MapError, RunError, RvadsError, ScenarioError
from pytest_rvads.support.wording import page

WORKFLOW = ".github/workflows/rules.yml"
"""Path in a repository: the workflow file that GitHub runs at every push."""
_START = "README"
"""The name of the page that leads to all other pages; the list of pages begins with it."""


def declare(commands: Subparsers) -> None:
    """Add the commands ``rvads init`` and ``rvads docs`` to the parser."""
    init = commands.add_parser(
        "init",
        help="write a first test and a controller to start from",
        description="Writes test_rules.py, and conftest.py with a controller to replace by yours. Changes no file that exists.",
    )
    init.add_argument("folder", metavar="DIR", nargs="?", default=".", help="folder for the files (default: working directory)")
    drives = init.add_mutually_exclusive_group()
    share(drives, "sut", help="let your program drive, in C++ or any language; it starts in DIR")
    drives.add_argument("--recordings", metavar="FILE", help="judge recorded runs of a file, folder or pattern; nothing drives")
    drives.add_argument("--ci", choices=("github",), help="write a workflow for GitHub Actions instead of tests")
    share(init, "map", help=f"drive at a junction of this map file ({MAP_FORMATS}), not at the built-in all-way stop")
    share(init, "junction", help="junction of --map (default: the first usable junction)")
    init.set_defaults(command=_init)
    docs = commands.add_parser(
        "docs",
        help="show a page of the documentation; without a page list all pages",
        description="Shows a page of the documentation in the terminal, as Markdown. The pages ship with the package.",
    )
    docs.add_argument("page", metavar="PAGE", nargs="?", help="name of the page, such as tutorial (default: list all pages)")
    docs.set_defaults(command=_docs)


def template(name: str, values: Mapping[str, object] | None = None) -> str:
    """Return the text of a template file, with `values` inserted as Python literals."""
    text = files("pytest_rvads.cli").joinpath("start", name).read_text(encoding="utf-8")
    return Template(text).substitute({key: repr(value) for key, value in values.items()}) if values else text


def _init(options: argparse.Namespace) -> int:
    if options.map and (options.recordings or options.ci):
        raise RvadsError(
            f"--map is for tests in which something drives: leave out --map or --{'ci' if options.ci else 'recordings'}"
        )
    if options.junction and not options.map:
        raise RvadsError("--junction names a junction of --map: name the file as well")
    folder = Path(options.folder)
    texts = {WORKFLOW: template("rules.yml")} if options.ci else _test_files(options, folder)
    paths = {folder / name: text for name, text in texts.items()}
    for path in paths:
        if os.path.lexists(path):
            raise RvadsError(f"{path} exists and is not changed, nothing was written: move it away, or name another folder")
    for path, text in paths.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with path.open("x", encoding="utf-8") as out:  # mode x: a file that was made in the meantime is not changed either
                out.write(text)
        except OSError as error:  # an error of writing names no path
            raise OSError(error.errno, error.strerror, str(path)) from error
    for path in paths:
        say(f"wrote {path}")
    for line in _next(options):
        say(line)
    return 0


def _test_files(options: argparse.Namespace, folder: Path) -> dict[str, str]:
    """Return the contents of the test files and of the driver's file, by names of files."""
    from_folder = options.recordings or options.map or ""  # a relative path is made relative to the folder of the tests
    if from_folder and not os.path.isabs(from_folder):
        from_folder = Path(os.path.relpath(from_folder, folder)).as_posix()
    if options.recordings:
        from pytest_rvads.runs.readers import READERS

        name, path = options.recordings, Path(options.recordings)
        is_pattern = any(sign in name for sign in "*?[")
        if not is_pattern and not path.exists():
            raise RunError(f"{name} does not exist: name a file of runs ({', '.join(READERS)}), a folder of them or a pattern")
        if not is_pattern and path.is_file() and path.suffix.lower() not in READERS:
            raise ScenarioError(
                f"{name} holds no runs ({', '.join(READERS)}); of tracks they are made by "
                f"rvads import {shlex.quote(name)} --map MAP.xodr --junction ID -o runs.npz"
            )
        return {"test_rules.py": template("test_recordings.txt", {"recordings": from_folder})}
    place, tests = None, template("test_rules.txt")
    if options.map:
        from pytest_rvads.geometry.finder import find
        from pytest_rvads.scenarios.classes import label
        from pytest_rvads.scenarios.selection import alone

        usable = [options.junction] if options.junction else conflicting(options.map)
        if not usable:
            where = f"rvads map {shlex.quote(options.map)}"
            raise MapError(f"{options.map} has no usable junction where ways meet: {where} tells why")
        place = find(usable[0], options.map)
        values = {
            "junction": usable[0],
            "grid": ("S21", "S46") if place.control is JunctionControl.STOP else ("S42", "S53"),
            "alone": tuple(label(code, place.lanes) for code in alone(place)),
            "first": "H" if place.control is JunctionControl.LIGHTS else "C",  # 20 m before the line
            "map": from_folder,
        }
        tests = template("test_map.txt", values)
    if options.sut:
        try:
            words = shlex.split(options.sut)
        except ValueError as error:
            raise RvadsError(f"--sut can't be read as a command: {error}, got {options.sut!r}") from error
        if not words:
            raise RvadsError(f"--sut is the command of your program, such as ./stack, got {options.sut!r}")
        drives = template("stack.txt", {"command": words})
    else:
        signs = {Sign.STOP} if place is None else {entrance.sign for entrance in place.entrances}
        fault = "not at a red light" if Sign.LIGHTS in signs else "not for who comes and has to be let pass"
        fault = "not at the stop sign" if Sign.STOP in signs else fault
        drives = Template(template("conftest.txt")).substitute(fault=fault)
    return {"conftest.py": drives, "test_rules.py": tests}


def _next(options: argparse.Namespace) -> list[str]:
    """Return lines for the user on the next steps after ``rvads init``."""
    if options.ci:
        advice = (
            "commit it; at each push GitHub runs pytest, shows failures beside the lines of their tests and keeps the reports"
        )
        source = (
            "RVADS in the file says from where pip installs pytest-rvads: until its first release, name the repository you cloned"
        )
        return [f"next: {advice}", source, f"more: {page('ci')}"]
    pytest = f"RVADS_HAND={options.hand} pytest" if options.hand else "pytest"
    steps = [f"next: {pytest}" if options.folder == "." else f"next: cd {shlex.quote(options.folder)} && {pytest}"]
    if options.recordings:
        return [*steps, f"more: {page('bring-recorded-runs')}"]
    failures = "The line `look` of a failure names a page that replays the run; the command in the line `rerun` repeats the run."
    if options.sut:
        folder, program = Path(options.folder), shlex.split(options.sut)[0]
        # A Path would drop the ./ of a program.
        if not shutil.which(os.path.join(folder, program) if "/" in program else program):
            where = f"at {folder / program}" if "/" in program else "on the PATH"
            steps.insert(0, f"There is no program {where} yet: put it there first.")
        return [*steps, failures, f"more: {page('attach-your-stack')}"]
    replacement = "Then put your controller in place of MyController in conftest.py."
    return [*steps, failures, replacement, f"more: {page('tutorial')}"]


def pages() -> dict[str, Path]:
    """Return the files of all pages by name; a page in a subfolder of the documentation is named ``folder/page``."""
    package = Path(pytest_rvads.__file__).parent
    for folder in (package / "docs", package.parent / "docs"):  # of an installed package, and of a checkout
        if found := {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.md"))}:
            return {_START: found.pop(_START), **found}
    raise RvadsError(
        f"the pages of the documentation are not in {package / 'docs'}, where the package has them: install it again"
    )


def _docs(options: argparse.Namespace) -> int:
    files = pages()
    if options.page is None:
        width = max(map(len, files))
        for name, path in files.items():
            say(f"{name:<{width}}  {path.read_text(encoding='utf-8').partition(chr(10))[0].removeprefix('# ')}")
        say("next: rvads docs PAGE")
        return 0
    page = options.page.removesuffix(".md")
    if page not in files:
        raise RvadsError(f"the documentation has no page {options.page!r}: rvads docs lists all pages")
    pager(files[page].read_text(encoding="utf-8"))
    return 0
