"""Finds and runs netconvert, SUMO's program that builds road networks from files in plain XML."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import Element, ElementTree, ParseError, fromstring

from pytest_rvads.support.errors import RunError, needs
from pytest_rvads.support.wording import one_line

__all__ = ["netconvert", "program_and_home"]

_LIMIT = 60.0
"""Longest duration of a call [s]; a junction takes some hundredths of a second."""
_RESULT = "net.xml"
_OPTIONS = (
    "--offset.disable-normalization",  # keep the frame of the map
    "--no-turnarounds",  # add no movements to those of the junction
    "--junctions.endpoint-shape",  # keep the ends of the lanes
    "--precision=9",
    "--xml-validation=never",
)


def netconvert(files: Mapping[str, Element], *, left_hand: bool) -> Element:
    """Return the network of plain XML files.

    Args:
        files: content of each input file, by the name of its option.
        left_hand: whether traffic keeps left.

    Raises:
        RunError: netconvert is not installed, or failed.
    """
    program, home = program_and_home()
    # Names without folders, because netconvert ends a path at a comma.
    names = {option: f"{option}.xml" for option in files}
    options = [f"--{option}={name}" for option, name in names.items()]
    options += [*_OPTIONS, *(["--lefthand"] if left_hand else []), f"--output-file={_RESULT}"]
    try:
        with TemporaryDirectory(prefix="rvads-net-") as folder:
            for option, root in files.items():
                ElementTree(root).write(Path(folder, names[option]), encoding="utf-8")
            messages = _run([program, *options], home, folder)
            result = Path(folder, _RESULT)
            content = result.read_bytes() if result.exists() else b""
    except OSError as error:
        raise RunError(f"files for SUMO's netconvert can't be written or read: {error}") from None
    try:
        return fromstring(content)
    except ParseError:
        raise RunError(f"SUMO's netconvert ({program}) made no network: {one_line(messages[-500:])}") from None


def _run(command: Sequence[str], home: str | None, folder: str) -> str:
    """Run a program in a folder and return its standard error."""
    try:
        finished = subprocess.run(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_LIMIT,
            check=False,
            env=os.environ | ({"SUMO_HOME": home} if home else {}),
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RunError(f"SUMO's netconvert can't be run: {one_line(str(error), 300)}") from None
    return finished.stderr.decode(errors="replace")


@lru_cache(maxsize=1)
def program_and_home() -> tuple[str, str | None]:
    """Return the paths of netconvert and of SUMO's home: of the package eclipse-sumo, else of SUMO_HOME, else from the PATH.

    Raises:
        RunError: netconvert is not installed.
    """
    spec = find_spec("sumo")
    homes = [*((spec and spec.submodule_search_locations) or ()), os.environ.get("SUMO_HOME", "")]
    for home in map(os.path.abspath, filter(None, homes)):  # absolute, because netconvert runs in another folder
        if program := shutil.which("netconvert", path=str(Path(home, "bin"))):
            return program, home
    program = shutil.which("netconvert")
    if program is None:
        raise RunError(needs("simulator 'sumo' makes networks by netconvert and", "eclipse-sumo", "sumo"))
    return os.path.abspath(program), None
