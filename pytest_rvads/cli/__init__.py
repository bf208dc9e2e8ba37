"""The command line tool ``rvads``: the functions of the package that need no pytest.

Standard output holds only the answer. Warnings and errors go to standard error; an error is one line, with exit status 2.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from textwrap import wrap

from pytest_rvads import __version__
from pytest_rvads.cli import check_commands, dynamics_command, first_commands, map_commands, replay_command, report_commands
from pytest_rvads.cli.common import warn
from pytest_rvads.support.errors import RvadsError, located
from pytest_rvads.support.installed import entries, load
from pytest_rvads.support.wording import encode_all, page

_GROUPS = {
    "start": ("init", "map", "rules", "docs"),
    "judge": ("check", "replay", "report", "import", "town"),
    "measure": ("critical", "dynamics"),
}
"""The commands that ``rvads --help`` explains, by group; it only names further commands."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tool ``rvads`` with some arguments, by default those of the command line, and return the exit status."""
    parser = argparse.ArgumentParser(
        prog="rvads",
        usage="rvads [--help] [--version] [--hand left|right] COMMAND ...",
        description="Validate autonomous-driving controllers against traffic rules.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"rvads {__version__}")
    parser.add_argument(
        "--hand",
        choices=("left", "right"),
        help="side on which traffic keeps, for maps of lanelets that do not show the side (also the variable RVADS_HAND)",
    )
    commands = parser.add_subparsers(prog="rvads", required=True, metavar="COMMAND", help=argparse.SUPPRESS)
    for module in (first_commands, map_commands, check_commands, dynamics_command, report_commands, replay_command):
        module.declare(commands)
    for name in entries("commands"):
        load("commands", name).declare(commands)
    helps = {action.dest: action.help or "" for action in commands._choices_actions}
    width, lines = shutil.get_terminal_size().columns - 2, list[str]()
    for title, names in _GROUPS.items():
        lines.append(f"{title}:")
        for name in filter(helps.__contains__, names):
            lines += wrap(helps[name], width, initial_indent=f"  {name:<10}", subsequent_indent=" " * 12)
    others = sorted(helps.keys() - {name for names in _GROUPS.values() for name in names})
    lines += wrap(f"further commands: {', '.join(others)} ({page('everything-else')})", width, subsequent_indent="  ")
    parser.epilog = "\n".join([*lines, f"documentation: {page()}"])
    return answer(parser, sys.argv[1:] if arguments is None else arguments)


def answer(parser: argparse.ArgumentParser, words: Sequence[str] | None = None) -> int:
    """Run the function that the parsed command line names as ``command``, and return the exit status."""
    if sys.stdout is None or sys.stdin is None:  # closed by the parent process
        warn("rvads: it needs an open standard input and output: redirect what is of no use to /dev/null")
        return 2
    encode_all(sys.stdout, sys.stderr)
    for option, value in pairwise([*(sys.argv[1:] if words is None else words), "-"]):  # such as an unset variable of a script
        if option.startswith("-") and (value == "" or (option.startswith("--") and option.endswith("="))):
            warn(f"rvads: {option.rstrip('=')} needs a value, got '': give a value, or leave the option out")
            return 2
    options = parser.parse_args(words)
    command: Callable[[argparse.Namespace], int] = options.command
    if getattr(options, "hand", None):
        from pytest_rvads.geometry.network import HAND

        os.environ[HAND] = options.hand  # other processes of the command read maps, too
    try:
        status = command(options)
        sys.stdout.flush()  # a full disk is an error of the command, not of the end of the process
        return status
    except BrokenPipeError:  # the reader, such as `head`, has closed the pipe; nothing more can be written
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (RvadsError, OSError) as error:
        # A formula's error shows its place in separate lines; programs that read standard error get one line.
        text = str(error) if sys.stderr.isatty() else " ".join(str(error).split())
        if isinstance(error, OSError) and error.filename is None:
            text += ": standard output or a temporary file can't be written"
            with suppress(OSError):  # what is left can't be written at the end of the process either
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        warn(f"rvads: {text}")
        return 2
    except KeyboardInterrupt:
        print("rvads: interrupted", file=sys.stderr)
        return 130
    except SystemExit as error:  # commands return a status, so this is code of a user
        warn(f"rvads: code that the command called raised {located(error)}")
        return 2
