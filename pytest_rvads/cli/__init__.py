"""The command ``rvads``: the functions of the package that need no pytest.

Standard output holds only the answer. Warnings and errors go to standard error; an error is one line, with exit status 2.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence

from pytest_rvads import __version__
from pytest_rvads.cli import (
    braking_command,
    check_commands,
    init_command,
    map_commands,
    replay_command,
    report_commands,
)
from pytest_rvads.cli.common import warn
from pytest_rvads.support.entrypoints import entries, load
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import encode_all, page

__all__ = ["answer", "main"]

_STUDIES = {"compare-simulators": "simulators", "power": "power", "simulate": "prediction"}
"""Former commands that measure the checks or the simulators themselves, and the modules of ``studies`` that replace them."""

_RENAMED = {
    **{(command, "--rule"): "--rules" for command in ("check", "export", "replay", "rules")},
    ("rules", "--file"): "--rules",
    ("init", "--stack"): "--sut",
}
"""Present names of options, by their command and their former name."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``rvads`` with the given words, by default the words of the command line, and return the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in _STUDIES:
        replacement = f"python -m studies.{_STUDIES[words[0]]}"
        warn(f"rvads: rvads {words[0]} is no part of the package any more: run {replacement} in a clone of the project")
        return 2
    return answer(_parser(), _renamed(words))


def answer(parser: argparse.ArgumentParser, words: Sequence[str] | None = None) -> int:
    """Run the function that the parsed command line names as ``command``, and return the exit status.

    Args:
        parser: sets ``command`` to a function that takes the parsed options and returns an exit status.
        words: the command line; by default that of the process.

    Returns:
        The status of the command; 2 after an error, which is printed in one line; 130 after Ctrl-C.
    """
    if sys.stdout is None or sys.stdin is None:  # closed by the parent process
        warn("rvads: it needs an open standard input and output: redirect what is of no use to /dev/null")
        return 2
    encode_all(sys.stdout, sys.stderr)
    options = parser.parse_args(words)
    command: Callable[[argparse.Namespace], int] = options.command
    try:
        return command(options)
    except BrokenPipeError:  # the reader, such as `head`, has closed the pipe; nothing more can be written
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (RvadsError, OSError) as error:
        # A formula's error shows its place in separate lines; programs that read standard error get one line.
        text = str(error) if sys.stderr.isatty() else " ".join(str(error).split())
        warn(f"rvads: {text}")
        return 2
    except KeyboardInterrupt:
        print("rvads: interrupted", file=sys.stderr)
        return 130


def _renamed(words: Sequence[str]) -> list[str]:
    """Return the words of a command with the present names of its options; a former name causes a warning."""
    former = {option: name for (command, option), name in _RENAMED.items() if words and command == words[0]}
    parts = [word.partition("=") for word in words]
    for option in dict.fromkeys(option for option, _, _ in parts if option in former):
        warn(f"rvads: warning: {option} of rvads {words[0]} is called {former[option]} now")
    return [former.get(option, option) + sign + value for option, sign, value in parts]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rvads",
        description="Validate autonomous-driving controllers against traffic rules.",
        epilog=f"Documentation: {page()}",
    )
    parser.add_argument("--version", action="version", version=f"rvads {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for module in (
        init_command,
        map_commands,
        check_commands,
        braking_command,
        report_commands,
        replay_command,
    ):
        module.declare(commands)
    for name in entries("commands"):
        load("commands", name).declare(commands)
    return parser
