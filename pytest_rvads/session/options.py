"""The options of the plugin, each a flag ``--rvads-*`` and an ini setting ``rvads_*``, read once into an `Options` object.

The simulator that an option names, and the limits of real time, are kept for the session.

A field of `Options` declares an option: its help, its default, and the function that makes the value of the field from the text
of the flag, the ini setting or the default.
"""

from __future__ import annotations

import argparse
import math
import os
import shlex
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pytest

from pytest_rvads.simulators.patience import NEVER, Limits
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import page

if TYPE_CHECKING:
    from pytest_rvads.simulators.simulator import Choice, Simulator

_Parse = Callable[[pytest.Config, str, Any], Any]
"""Returns the value of an option from the configuration of the session, the ini name of the option, and its text or texts.

It is not called for an empty text, whose value is None. Raises an `RvadsError` for a text that is no value of the option.
"""


@dataclass(frozen=True, slots=True)
class _Option:
    """The declaration of an option: help, the function that reads its text, and default."""

    help: str
    """The text of ``pytest --rvads-help``; ``pytest --help`` shows the text up to the first semicolon, of everyday options."""
    parse: _Parse
    default: str = ""
    metavar: str = ""
    """The value in help texts; without it the last word of the option's name."""
    choices: tuple[str, ...] | None = None
    several: bool = False
    """Whether the flag can be given several times; the ini setting of such an option has one value per line."""
    everyday: bool = False
    again: bool = False
    """Whether commands that run an item once more repeat the flag."""


def _option(help: str, parse: _Parse, default: str = "", metavar: str = "", **more: Any) -> Any:
    """Return a dataclass field of `Options`, with the arguments of `_Option`."""
    return field(metadata={"option": _Option(help, parse, default, metavar, **more)})


def _text(_config: pytest.Config, _name: str, text: str) -> str:
    return text


def _count(_config: pytest.Config, name: str, text: str, least: int = 1) -> int:
    if not (text.isdecimal() and len(text) < 10 and int(text) >= least):
        raise RvadsError(f"{name} must be a whole number from {least} to 999999999, got {text!r:.60}")
    return int(text)


def _number(_config: pytest.Config, name: str, text: str, most: float) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 <= number <= most:
        raise RvadsError(f"{name} must be a number from 0 to {most:g}, got {text!r}")
    return number


def _seconds(config: pytest.Config, name: str, text: str) -> float:
    """Return a time limit above 0 [s]."""
    seconds = _number(config, name, text, 3600.0)
    if not seconds:
        raise RvadsError(f"{name} must be a number above 0, at most 3600, got {text!r}")
    return seconds


def _rate(config: pytest.Config, name: str, text: str) -> float:
    """Return a number of decisions per second that divides 100 [Hz]."""
    rate = _number(config, name, text, 100.0)
    if not (rate and math.isclose(round(100.0 / rate) * rate, 100.0)):
        raise RvadsError(f"{name} must divide 100, such as 10, 20, 25 or 50, got {text!r}")
    return rate


def _speed(_config: pytest.Config, name: str, text: str) -> float:
    """Return a speed limit [m/s]."""
    from pytest_rvads.geometry.opendrive.map_file import speed_of

    return speed_of(text, name)


def _path_from_start(config: pytest.Config, _name: str, text: str) -> Path:
    return config.invocation_params.dir / text


def _map(config: pytest.Config, name: str, text: str) -> str:
    """Return the map file; a flag or variable is relative to the working directory, an ini setting to pytest's root folder."""
    named_here = config.getoption(name) or os.environ.get("RVADS_MAP")
    return str((Path.cwd() if named_here else config.rootpath).joinpath(text).resolve())


def _reports(config: pytest.Config, name: str, paths: Sequence[str]) -> tuple[Path, ...]:
    from pytest_rvads.report.files import FORMATS

    formats = [ending for ending in FORMATS if ending != ".xml"]
    for path in paths:
        if Path(path).suffix not in formats:
            hint = f": pytest writes JUnit XML, --junitxml={path}" if Path(path).suffix == ".xml" else ""
            raise RvadsError(f"{name} must name a {', '.join(formats)} file, got {path!r}{hint}")
    return tuple(config.invocation_params.dir / path for path in paths)


def _command(config: pytest.Config, name: str, text: str) -> tuple[str, ...] | None:
    """Return the words of a command, with the absolute path of its program."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise RvadsError(f"{name} can't be read as a command: {error}, got {text!r}") from error
    if not words:
        return None
    program = shutil.which(str(config.invocation_params.dir / words[0]) if "/" in words[0] else words[0])
    if program is None:
        raise RvadsError(f"{name} must be the command of a program that exists and may be executed, got {text!r}")
    return (program, *words[1:])


def _outcomes(_config: pytest.Config, name: str, text: str) -> frozenset[str]:
    """Return the outcomes that fail a test besides FAIL and ERROR."""
    outcomes = frozenset(text.replace(" ", "").split(",")) - {"none"}
    if unknown := outcomes - {"open", "unavoidable", "unsure"}:
        raise RvadsError(f"{name} must name outcomes of open, unavoidable, unsure, or none, got {min(unknown)!r:.60}")
    return outcomes


@dataclass(frozen=True, slots=True)
class Options:
    """The options of a session, from the command line, the environment or the configuration file, in this order."""

    again: str
    """The pytest command, without the quoted id of the item, that runs an item of this session once more.

    The command has the session's flags for driver, map, simulator, rules and selection of items.
    """
    sut: tuple[str, ...] | None = _option(
        "command of the stack that drives, in another process; see 'Attach your stack' in the documentation; in a folder without "
        "tests, the tests of the plugin run",
        _command,
        metavar="COMMAND",
        everyday=True,
        again=True,
    )
    autopilot: str | None = _option(
        "controller that drives: module:name of your class, reference, or another traffic policy; reference is the bundled "
        "autopilot, which obeys the rulebook road; replaces the fixture rvads_autopilot",
        _text,
        metavar="NAME",
        everyday=True,
        again=True,
    )
    simulator: str | None = _option(
        "simulator: bullet, mujoco, sumo, or module:name of yours; by default bullet, or mujoco if pybullet is missing",
        _text,
        metavar="NAME",
        everyday=True,
        again=True,
    )
    sut_rate: float | None = _option(
        "decisions of the stack per simulated second; by default the rate that the stack requests, else 20",
        _rate,
        metavar="HZ",
        again=True,
    )
    sut_timeout: float = _option(
        "longest real time for one decision of the stack; three times as long, at least 15 s, for its start and for its "
        "preparation of a scenario",
        _seconds,
        "5",
        "SECONDS",
    )
    decision_limit: float = _option(
        "longest real time for one call into a driver; 0 for no limit. A longer call makes the item an ERROR, and after three "
        "such runs in a row all further runs of the driver are ERRORs",
        partial(_number, most=1e6),
        "15",
        "SECONDS",
    )
    run_limit: float = _option("longest real time for a run; 0 for no limit", partial(_number, most=1e6), "300", "SECONDS")
    speed_limit: float | None = _option(
        "speed limit everywhere, such as 30mph, 50km/h or 13.9 for m/s; by default the speed limits of the map, and 25 mph on "
        "roads without a speed limit",
        _speed,
        metavar="SPEED",
        again=True,
    )
    map: str | None = _option(
        "map file for junctions that are not built in; also the variable RVADS_MAP", _map, everyday=True, again=True
    )
    cover: str = _option(
        "scenarios to run of every class, or of a junction, for tests without cover=",
        _text,
        "class",
        choices=("class", "scenario", "rotation", "partial", "pairs", "conflicts"),
        again=True,
    )
    grid: str | None = _option(
        "configurations for tests without grid=: 'paper', letters such as CD, 'arrivals', 'staggered', S21 or the name of your "
        "grid; by default paper, and arrivals for tests with a subject",
        _text,
        again=True,
    )
    max_items: int = _option("refuse a test that would expand to more items than this", _count, "10000", again=True)
    sample: int | None = _option(
        "run only N runs of every test over scenarios; these are drawn as evenly as possible over its junctions, their classes "
        "and their configurations",
        _count,
        metavar="N",
        everyday=True,
        again=True,
    )
    seed: int = _option(
        "seed of the samples of --rvads-sample and of limit= in marks", partial(_count, least=0), "0", "S", again=True
    )
    rules: Path | None = _option(
        "file with your rules; see `rvads rules FILE`",
        lambda config, _, text: config.rootpath / text,
        everyday=True,
        again=True,
    )
    keep: Path | None = _option("folder in which every run is saved, as .npz for `rvads check`", _path_from_start)
    report: tuple[Path, ...] = _option(
        "also write the verdicts to FILE.json, FILE.html, FILE.md, FILE.csv (by requirement), or in a format of another package; "
        "repeatable",
        _reports,
        metavar="FILE",
        several=True,
        everyday=True,
    )
    cov_fail_under: float | None = _option(
        "fail when less than N percent of the (class x configuration x rule) cells that the collected tests expand to, "
        "before -k and -m, were exercised; NA exercises nothing",
        partial(_number, most=100.0),
        metavar="N",
    )
    cov_arrivals: float | None = _option(
        "fail when more than SECONDS between two tried differences of arrivals were not tried, for any two conflicting movements "
        "on which vehicles met within 6 s of each other",
        partial(_number, most=12.0),
        metavar="SECONDS",
    )
    baseline: Path | None = _option(
        "earlier report, FILE.json of --rvads-report; the session reports all changes since then",
        _path_from_start,
        metavar="FILE",
        everyday=True,
    )
    fail_on: str = _option(
        "failures that fail the session: any, new ones since the baseline, or these and eroded margins",
        _text,
        "any",
        choices=("any", "new", "eroded"),
        everyday=True,
    )
    time_budget: float | None = _option(
        "after SECONDS no item starts, and the items left are NOT RUN; the last failures run first, then one run of every class, "
        "then the items that ran least often",
        partial(_number, most=1e6),
        metavar="SECONDS",
    )
    artefacts: str | None = _option(
        "folder with a subfolder per session, for its page, its report, its failed runs and their replay pages, see "
        "`rvads replay`; or 'none'",
        lambda _config, _name, text: None if text == "none" else text,
        ".rvads",
    )
    strict: frozenset[str] = _option(
        "outcomes that fail a test besides FAIL, separated by commas, or none: open (an obligation is open when the run ends), "
        "unavoidable (no vehicle could have kept the rule), unsure (the recording is too inaccurate for a verdict). Outcomes "
        "that are not named skip the test, and an unavoidable violation passes",
        _outcomes,
        "open",
        metavar="OUTCOMES",
    )

    @property
    def driver(self) -> str:
        """The option that names the driver, with its value; empty if no option names a driver."""
        if self.autopilot:
            return f"--rvads-autopilot={self.autopilot}"
        return f"--rvads-sut={shlex.join(self.sut)}" if self.sut else ""

    @classmethod
    def read(cls, config: pytest.Config) -> Options:
        """Read the options of a session."""
        texts: dict[str, str] = {}
        for name, option in _DECLARED.items():
            ini, flag = _ini_name(name), config.getoption(_ini_name(name))
            if isinstance(flag, str) and not flag.strip():  # for example an unset variable of a CI job
                raise RvadsError(f"{_flag(name)} needs a value, got {flag!r}: give a value, or leave the option out")
            variable = os.environ.get("RVADS_MAP") if name == "map" else None
            texts[name] = flag or variable or config.getini(ini) or option.default
            if option.choices and texts[name] and texts[name] not in option.choices:
                raise RvadsError(f"{ini} must be one of {', '.join(option.choices)}, got {texts[name]!r}")
        if texts["sut"] and texts["autopilot"]:
            raise RvadsError(
                f"rvads_sut and rvads_autopilot both say what drives, got {texts['sut']!r} and {texts['autopilot']!r}"
            )
        if texts["fail_on"] != "any" and not texts["baseline"]:
            raise RvadsError(f"rvads_fail_on={texts['fail_on']} needs something to compare with: add --rvads-baseline=FILE.json")
        values: dict[str, Any] = {}
        for name, option in _DECLARED.items():  # most options are not set, and need no format and no reader of maps
            nothing = () if option.several else None
            values[name] = option.parse(config, _ini_name(name), texts[name]) if texts[name] else nothing
        # The next session reads the same ini file, so the command repeats flags only.
        flags = ((name, config.getoption(_ini_name(name))) for name, option in _DECLARED.items() if option.again)
        again = shlex.join(["pytest", *(f"{_flag(name)}={value}" for name, value in flags if value)])
        return cls(again, **values)


OPTIONS: pytest.StashKey[Options] = pytest.StashKey()
"""Key in the stash of pytest's configuration under which the options of the session are stored."""
_DECLARED: dict[str, _Option] = {item.name: item.metadata["option"] for item in fields(Options) if item.metadata}
_HELP = "--rvads-help"


def declare(parser: pytest.Parser) -> None:
    """Add the flag and the ini setting of every option to pytest's parser."""
    group = parser.getgroup("rvads", f"traffic-rule validation (pytest-rvads; documentation: {page()})")
    for name, option in _DECLARED.items():
        ini, keywords = _ini_name(name), _keywords(name, option)
        group.addoption(
            _flag(name), **keywords | {"help": option.help.partition(";")[0] if option.everyday else argparse.SUPPRESS}
        )
        kind: Literal["linelist", "string"] = "linelist" if option.several else "string"
        parser.addini(ini, f"see {_HELP}", kind, [] if option.several else "")
    shows = f"show all {len(_DECLARED)} options of this plugin, and exit"
    group.addoption(_HELP, dest="rvads_help", action="store_true", help=shows)


def all_options() -> argparse.ArgumentParser:
    """Return a parser of the plugin's options alone, with their whole help texts."""
    parser = argparse.ArgumentParser(prog="pytest", usage="pytest [--rvads-OPTION=VALUE ...]", add_help=False)
    group = parser.add_argument_group(
        "rvads", "Each option is also a setting of pytest's ini file, whose name stands in brackets."
    )
    for name, option in _DECLARED.items():
        group.add_argument(_flag(name), **_keywords(name, option))
    return parser


def _keywords(name: str, option: _Option) -> dict[str, Any]:
    """Return the keyword arguments with which an option is added to a parser."""
    ini = _ini_name(name)
    help_text = f"{option.help} (ini: {ini}{f', default {option.default}' if option.default else ''})"
    keywords: dict[str, Any] = {"dest": ini, "default": None, "help": help_text.replace("%", "%%")}
    keywords |= {"action": "append"} if option.several else {}
    metavar = option.metavar or name.rpartition("_")[2].upper()
    return keywords | ({"choices": option.choices} if option.choices else {"metavar": metavar})


def _ini_name(name: str) -> str:
    return f"rvads_{name}"


def _flag(name: str) -> str:
    return f"--rvads-{name.replace('_', '-')}"


NAMED: pytest.StashKey[Simulator | None] = pytest.StashKey()
"""The simulator that an option names; None if no option names one."""
LIMITS: pytest.StashKey[Limits] = pytest.StashKey()
"""The limits of real time of the session's runs."""


@contextmanager
def limits(config: pytest.Config) -> Iterator[Limits]:
    """Yield the limits of real time for runs and decisions that the session's options set.

    The timer of faulthandler exists once per process. If pytest uses this timer (``faulthandler_timeout``), the limits of the
    session end no process.
    """
    options = config.stash[OPTIONS]
    try:
        timer_in_use = float(config.getini("faulthandler_timeout") or 0) > 0
    except ValueError:  # the faulthandler plugin of pytest is switched off
        timer_in_use = False
    dump: int | None = NEVER
    if not timer_in_use:
        try:
            dump = os.dup(2)  # pytest redirects the descriptor 2 while items run
        except OSError:
            dump = None
    try:
        yield Limits(options.decision_limit, options.run_limit, dump)
    finally:
        if dump not in (None, NEVER):
            os.close(dump)


def choice_of(config: pytest.Config) -> Choice:
    """Return the simulator of the session with the session's limits of real time."""
    from pytest_rvads.simulators.simulator import Choice

    return Choice.of(config.stash[NAMED], config.stash[LIMITS])
