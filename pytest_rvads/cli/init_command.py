"""``rvads init``: writes files to start from."""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from string import Template

from pytest_rvads.cli.common import Subparsers, say
from pytest_rvads.support.errors import MapError, RunError, RvadsError, ScenarioError
from pytest_rvads.support.wording import page

__all__ = ["WORKFLOW", "declare", "template"]

WORKFLOW = ".github/workflows/rules.yml"
"""Path of GitHub's workflow file for pushes."""


def declare(commands: Subparsers) -> None:
    """Add the command of this module."""
    init = commands.add_parser(
        "init",
        help="write a first test and what drives in it, to start from",
        description="Writes test_rules.py, and conftest.py with a controller to replace by yours. Changes no file that exists.",
    )
    init.add_argument("folder", metavar="DIR", nargs="?", default=".", help="where to write (default: here)")
    drives = init.add_mutually_exclusive_group()
    drives.add_argument("--sut", metavar="COMMAND", help="a program of yours drives, in C++ or any language; started in DIR")
    drives.add_argument("--recordings", metavar="FILE", help="nothing drives: judge runs of a file, folder or pattern")
    drives.add_argument("--ci", choices=("github",), help="write a workflow for GitHub Actions instead of tests")
    init.add_argument(
        "--map", metavar="FILE", help="drive at a junction of this OpenDRIVE file, not at the built-in all-way stop"
    )
    init.add_argument("--junction", metavar="ID", help="which junction of --map (default: the first that can be used)")
    init.set_defaults(command=_init)


def template(name: str, values: Mapping[str, object] | None = None) -> str:
    """Return the text of a file to start from, with `values` inserted as Python literals."""
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
    texts = {WORKFLOW: template("rules.yml")} if options.ci else _tests(options, folder)
    for path in _write(folder, texts):
        say(f"wrote {path}")
    for line in _next(options):
        say(line)
    return 0


def _tests(options: argparse.Namespace, folder: Path) -> dict[str, str]:
    """Return the tests and their driver, by the names of their files."""
    if options.recordings:
        return {"test_rules.py": template("test_recordings.txt", {"recordings": _recordings(options.recordings, folder)})}
    drives = template("stack.txt", {"command": _command(options.sut)}) if options.sut else template("conftest.txt")
    if not options.map:
        return {"conftest.py": drives, "test_rules.py": template("test_rules.txt")}
    at = _place(options.map, options.junction) | {"map": _seen_from(folder, options.map)}
    return {"conftest.py": drives, "test_rules.py": template("test_map.txt", at)}


def _write(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write files; none is written if a file exists.

    Raises:
        RvadsError: a file exists.
        OSError: a file can't be written.
    """
    paths = {folder / name: text for name, text in texts.items()}
    for path in paths:
        if os.path.lexists(path):
            raise RvadsError(f"{path} exists and is not changed, nothing was written: move it away, or name another folder")
    for path, text in paths.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as out:  # a file that was made meanwhile is not changed either
            out.write(text)
    return list(paths)


def _next(options: argparse.Namespace) -> list[str]:
    """Return lines on the next steps."""
    if options.ci:
        told = "commit it; at each push GitHub runs pytest, shows failures beside the lines of their tests and keeps the reports"
        return [f"next: {told}", f"more: {page('ci')}"]
    next_ = ["next: pytest" if options.folder == "." else f"next: cd {shlex.quote(options.folder)} && pytest"]
    if options.recordings:
        return [*next_, f"more: {page('bring-recorded-runs')}"]
    failures = "The line `look` of a failure names a page that replays it, the line `rerun` runs it once more."
    if options.sut:
        return [*_missing(options.sut, Path(options.folder)), *next_, failures, f"more: {page('attach-your-stack')}"]
    own = "Then put your controller in place of MyController in conftest.py."
    return [*next_, failures, own, f"more: {page('tutorial')}"]


def _missing(command: str, folder: Path) -> list[str]:
    """Return a line if the program of a command does not exist yet."""
    program = _command(command)[0]
    if shutil.which(os.path.join(folder, program) if "/" in program else program):  # a Path would drop the ./ of a program
        return []
    where = f"at {folder / program}" if "/" in program else "on the PATH"
    return [f"There is no program {where} yet: put it there first."]


def _command(text: str) -> list[str]:
    """Return the words of a command."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise RvadsError(f"--sut can't be read as a command: {error}, got {text!r}") from error
    if not words:
        raise RvadsError(f"--sut is the command of your program, such as ./stack, got {text!r}")
    return words


def _place(file: str, wanted: str | None) -> dict[str, object]:
    """Return a junction of a map and the starts of its vehicles: the given junction, or the first junction with meeting ways."""
    from pytest_rvads.geometry.conflicts import JunctionKind
    from pytest_rvads.geometry.control import JunctionControl
    from pytest_rvads.geometry.finder import find
    from pytest_rvads.geometry.road_map import describe, read_map
    from pytest_rvads.scenarios.classes import label
    from pytest_rvads.scenarios.selection import alone

    junctions = describe(read_map(file))["junctions"] if wanted is None else ()
    usable = [wanted] if wanted else [one["id"] for one in junctions if one["kind"] not in (None, JunctionKind.CONFLICT_FREE)]
    if not usable:
        raise MapError(f"{file} has no usable junction where ways meet: rvads map {shlex.quote(file)} tells why")
    place = find(usable[0], file)
    return {
        "junction": usable[0],
        "grid": ("S21", "S46") if place.control is JunctionControl.STOP else ("S42", "S53"),
        "alone": tuple(label(code, place.lanes) for code in alone(place)),
        "first": "H" if place.control is JunctionControl.LIGHTS else "C",  # 20 m before the line
    }


def _recordings(name: str, folder: Path) -> str:
    """Return the path of recordings relative to the folder, after checking that recordings in a known format exist."""
    from pytest_rvads.runs.readers import READERS

    if not any(sign in name for sign in "*?["):
        path = Path(name)
        if not path.exists():
            raise RunError(f"{name} does not exist: name a file of runs ({', '.join(READERS)}), a folder of them or a pattern")
        if path.is_file() and path.suffix.lower() not in READERS:
            raise ScenarioError(
                f"{name} holds no runs ({', '.join(READERS)}); of tracks they are made by "
                f"rvads import {shlex.quote(name)} --map MAP.xodr --junction ID -o runs.npz"
            )
    return _seen_from(folder, name)


def _seen_from(folder: Path, name: str) -> str:
    """Return a path, relative to the working directory, as a path relative to the folder of a test."""
    return name if os.path.isabs(name) else Path(os.path.relpath(name, folder)).as_posix()
