"""The options of the plugin: each a ``--rvads-*`` flag with an ini twin ``rvads_*``, read once into one frozen object."""

from __future__ import annotations

import math
import os
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.errors import RvadsError
from pytest_rvads.wording import page

__all__ = ["OPTIONS", "Options", "declare"]


@dataclass(frozen=True, slots=True)
class _Option:
    """How an option is declared."""

    help: str
    default: str = ""
    choices: tuple[str, ...] | None = None
    metavar: str | None = None
    """By default the last word of the option's name."""
    several: bool = False
    """The flag may be repeated; the ini holds one value per line."""


_DECLARED = {
    "sut": _Option(
        "system under test: the command of a stack in another process, see 'Attach your stack' in the documentation; where there "
        "are no tests, those that come with the plugin run",
        metavar="COMMAND",
    ),
    "autopilot": _Option(
        "system under test: 'reference' for the bundled one, as it obeys the rulebook road, another traffic policy, or "
        "module:name of your class, whatever the fixtures say",
        metavar="NAME",
    ),
    "simulator": _Option(
        "what makes the runs: bullet, mujoco, sumo, or module:name of yours; by default bullet, and mujoco where there is no "
        "pybullet",
        metavar="NAME",
    ),
    "sut-rate": _Option("decisions of the stack per simulated second; by default what it asks for, else 20", metavar="HZ"),
    "sut-timeout": _Option("how long the stack may take for one decision, in real time", "5", metavar="SECONDS"),
    "sut-startup": _Option(
        "how long the stack may take to start, and to get ready for a scenario, in real time", "15", metavar="SECONDS"
    ),
    "sut-grace": _Option("how long the stack may take to exit after bye, and after SIGTERM", "1", metavar="SECONDS"),
    "decision-limit": _Option(
        "how long one call into a driver may take, in real time; 0 for no limit. What takes longer is an ERROR, and after three "
        "such runs in a row what this driver has left is",
        "15",
        metavar="SECONDS",
    ),
    "run-limit": _Option("how long a run may take, in real time; 0 for no limit", "300", metavar="SECONDS"),
    "speed-limit": _Option(
        "speed limit everywhere, such as 30mph, 50km/h or 13.9 for m/s; by default what the map states, and 25 mph where it "
        "states none",
        metavar="SPEED",
    ),
    "map": _Option("OpenDRIVE file for junctions that are not built in (also the variable RVADS_MAP)"),
    "cover": _Option(
        "what to run of every class, or of the scenarios of a junction, where a test does not say",
        choices=("class", "scenario", "rotation", "partial", "pairs", "conflicts"),
    ),
    "grid": _Option(
        "configurations where a test does not say: 'paper', letters such as CD, 'arrivals', 'staggered', S21 or a name of yours; "
        "by default paper, and arrivals for tests with a subject"
    ),
    "max-items": _Option("refuse a test that would expand to more items than this", "10000"),
    "sample": _Option(
        "run only N runs of every test over scenarios, drawn as evenly as possible over its junctions, their classes and their "
        "configurations",
        metavar="N",
    ),
    "seed": _Option("what --rvads-sample and limit= of marks draw by; other seeds draw others", "0", metavar="S"),
    "rules": _Option("file with rules of your own, see `rvads rules --rules`"),
    "keep": _Option("folder to keep every run in, as .npz for `rvads check`"),
    "export": _Option(
        "folder to write every run that failed to as OpenSCENARIO XML (.xosc), its map beside it; needs the extra openscenario"
    ),
    "report": _Option(
        "also write the verdicts to FILE.json, FILE.html, FILE.md, FILE.csv (by requirement), FILE.xml (JUnit), or in a format "
        "of another package; repeatable",
        metavar="FILE",
        several=True,
    ),
    "summary": _Option(
        "how much of the verdicts to show at the end: no more than a screen, or all", "compact", ("compact", "full")
    ),
    "cov-fail-under": _Option(
        "fail when less than N percent of the (class x configuration x rule) cells that the collected tests expand to, "
        "before -k and -m, were exercised; NA exercises nothing",
        metavar="N",
    ),
    "baseline": _Option("compare with an earlier report, FILE.json of --rvads-report, and tell what changed", metavar="FILE"),
    "baseline-of": _Option(
        "with a baseline: compare only items of the same driver, the same map and the same formula of the rule, or any",
        "same",
        ("same", "any"),
    ),
    "erosion": _Option("with a baseline: a safety margin that fell by more than this is told", "0.5", metavar="SECONDS"),
    "fail-on": _Option(
        "which failures fail the session: any; new ones, that the baseline does not have; or those and eroded margins",
        "any",
        ("any", "new", "eroded"),
    ),
    "time-budget": _Option(
        "start no item later than this: last failures run first, then one run of every class, then what ran least so far; "
        "the rest is NOT RUN",
        metavar="SECONDS",
    ),
    "repeat": _Option(
        "whether to simulate the run of a failed item once more, which tells an autopilot that is not deterministic (FLAKY)",
        "failed",
        ("failed", "never"),
    ),
    "artefacts": _Option(
        "folder below which every session has one of its own, with its page, its report, the runs that failed and their replay "
        "pages, see `rvads replay`; or 'none'",
        ".rvads",
    ),
    "keep-sessions": _Option("how many sessions stay in that folder, this one included", "5", metavar="N"),
    "unavoidable": _Option("what a violation that nobody could have avoided does to its test", "pass", ("pass", "fail")),
    "unsure": _Option(
        "what a verdict does to its test that another reading of the recording, within its accuracy, would change",
        "skip",
        ("skip", "fail"),
    ),
    "open": _Option("what an obligation still open at the end of a run does to its test", "fail", ("fail", "skip", "pass")),
}


@dataclass(frozen=True, slots=True)
class Options:
    """What was asked for on the command line, in the environment or in the configuration file, in this order."""

    sut: tuple[str, ...] | None
    """Command of the stack under test, with an absolute path."""
    autopilot: str | None
    """What drives by name, see `--rvads-autopilot`."""
    simulator: str | None
    """By name, see `--rvads-simulator`; None for the usual one."""
    sut_rate: float | None
    """[Hz]."""
    sut_timeout: float
    """[s]."""
    sut_startup: float
    """[s]."""
    sut_grace: float
    """[s]."""
    decision_limit: float
    """Of one call into a driver, 0 for none [s]."""
    run_limit: float
    """Of a run, 0 for none [s]."""
    speed_limit: float | None
    """In place of all that maps and recordings state [m/s]."""
    map: str | None
    cover: str
    grid: str | None
    """None where every test takes its usual one."""
    max_items: int
    sample: int | None
    """Most runs of a test."""
    seed: int
    """Of samples."""
    rules: Path | None
    keep: Path | None
    export: Path | None
    """Where runs that failed go as OpenSCENARIO XML."""
    reports: tuple[Path, ...]
    """Files to write; the ending of each names its format."""
    summary: str
    """compact or full."""
    cov_fail_under: float | None
    """Least share of the cells to be exercised [%]."""
    baseline: Path | None
    baseline_of: str
    """Which of its items are compared: same or any."""
    erosion: float
    """A safety margin that fell by more than this since the baseline is told [s]."""
    fail_on: str
    """Which failures fail the session: any, new or eroded."""
    time_budget: float | None
    """No item starts later than this [s]."""
    repeat: str
    """Which runs are simulated once more: failed or never."""
    artefacts: str | None
    """Folder that holds a folder per session."""
    keep_sessions: int
    """Number of latest sessions whose folders are kept."""
    again: str
    """The command that runs an item once more as it ran here, when its id follows in quotes."""
    open: str
    """What OPEN does to a test: fail, skip or pass."""
    unavoidable: str
    """What UNAVOIDABLE does to a test: pass or fail."""
    unsure: str
    """What UNSURE does to a test: skip or fail."""

    @property
    def driver(self) -> str:
        """What drives, as the options say; nothing where fixtures do."""
        if self.autopilot:
            return f"--rvads-autopilot={self.autopilot}"
        return f"--rvads-sut={shlex.join(self.sut)}" if self.sut else ""

    @classmethod
    def read(cls, config: pytest.Config) -> Options:
        """Read the options of a session.

        Raises:
            RvadsError: a value out of range.
        """
        values = {name: _value(config, name) for name, option in _DECLARED.items() if not option.several}
        here = config.invocation_params.dir
        if values["sut"] and values["autopilot"]:
            raise RvadsError(
                f"rvads_sut and rvads_autopilot both say what drives, got {values['sut']!r} and {values['autopilot']!r}"
            )
        return cls(
            sut=_command(values["sut"], here),
            autopilot=values["autopilot"] or None,
            simulator=values["simulator"],
            sut_rate=_rate(values["sut-rate"]),
            sut_timeout=_seconds("sut-timeout", values["sut-timeout"]),
            sut_startup=_seconds("sut-startup", values["sut-startup"]),
            sut_grace=_number("sut-grace", values["sut-grace"], 3600.0) or 0.0,
            decision_limit=_number("decision-limit", values["decision-limit"], 1e6) or 0.0,
            run_limit=_number("run-limit", values["run-limit"], 1e6) or 0.0,
            speed_limit=_speed(values["speed-limit"]),
            map=_map(config),
            cover=values["cover"] or "class",
            grid=values["grid"] or None,
            max_items=_count("max-items", values["max-items"]),
            sample=_count("sample", values["sample"]) if values["sample"] else None,
            seed=_count("seed", values["seed"], least=0),
            rules=config.rootpath / values["rules"] if values["rules"] else None,
            keep=here / values["keep"] if values["keep"] else None,
            export=here / values["export"] if values["export"] else None,
            reports=_reports(config, here),
            summary=values["summary"],
            cov_fail_under=_number("cov-fail-under", values["cov-fail-under"], 100.0),
            baseline=_baseline(values, here),
            baseline_of=values["baseline-of"],
            erosion=_number("erosion", values["erosion"], 3600.0) or 0.0,
            fail_on=values["fail-on"],
            time_budget=_number("time-budget", values["time-budget"], 1e6),
            repeat=values["repeat"],
            artefacts=None if values["artefacts"] == "none" else values["artefacts"],
            keep_sessions=_count("keep-sessions", values["keep-sessions"]),
            again=_again(config),
            open=values["open"],
            unavoidable=values["unavoidable"],
            unsure=values["unsure"],
        )


OPTIONS: pytest.StashKey[Options] = pytest.StashKey()
"""The options of a session, in the stash of its configuration."""


def declare(parser: pytest.Parser) -> None:
    """Add every option and its ini twin to pytest's parser."""
    group = parser.getgroup("rvads", f"traffic-rule validation (pytest-rvads), documented at {page()}")
    for name, option in _DECLARED.items():
        dest = _dest(name)
        more: dict[str, Any] = {"action": "append"} if option.several else {}
        more |= {"choices": option.choices} if option.choices else {"metavar": option.metavar or name.rpartition("-")[2].upper()}
        help_text = f"{option.help} (ini: {dest}{f', default {option.default}' if option.default else ''})"
        group.addoption(f"--rvads-{name}", dest=dest, default=None, help=help_text.replace("%", "%%"), **more)
        if option.several:
            parser.addini(dest, help=option.help, type="linelist", default=[])
        else:
            parser.addini(dest, help=option.help, type="string", default="")


def _dest(name: str) -> str:
    return f"rvads_{name.replace('-', '_')}"


def _value(config: pytest.Config, name: str) -> str:
    option, dest = _DECLARED[name], _dest(name)
    flag = config.getoption(dest)
    if flag is not None and not flag.strip():  # as where a variable of a CI job is not set
        raise RvadsError(f"--rvads-{name} needs a value, got {flag!r}: leave it out for what holds without it")
    value: str = flag or config.getini(dest) or option.default
    if option.choices and value and value not in option.choices:
        raise RvadsError(f"{dest} must be one of {', '.join(option.choices)}, got {value!r}")
    return value


def _again(config: pytest.Config) -> str:
    """Return the pytest command with this session's options for driver, map, simulator, rules and selection of items.

    Settings of the ini file are not repeated: the next session reads the same ini file.
    """
    drives = ("sut", "sut-rate", "autopilot", "simulator", "speed-limit", "map", "rules")
    names = (*drives, "cover", "grid", "max-items", "sample", "seed")
    given = ((name, config.getoption(_dest(name))) for name in names)
    return shlex.join(["pytest", *(f"--rvads-{name}={value}" for name, value in given if value)])


def _count(name: str, value: str, least: int = 1) -> int:
    if not (value.isdecimal() and len(value) < 10 and int(value) >= least):
        raise RvadsError(f"{_dest(name)} must be a whole number from {least} to 999999999, got {value!r:.60}")
    return int(value)


def _number(name: str, value: str, most: float) -> float | None:
    """Return a number from 0 to `most`, or None where nothing was said."""
    if not value:
        return None
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0 <= number <= most:
        raise RvadsError(f"{_dest(name)} must be a number from 0 to {most:g}, got {value!r}")
    return number


def _seconds(name: str, value: str) -> float:
    """Return a time limit, which can't be 0 [s]."""
    seconds = _number(name, value, 3600.0)
    if not seconds:
        raise RvadsError(f"{_dest(name)} must be a number above 0, at most 3600, got {value!r}")
    return seconds


def _rate(value: str) -> float | None:
    """Return how often a stack decides [Hz], or None where nothing was said."""
    rate = _number("sut-rate", value, 100.0)
    if rate is not None and not (rate and math.isclose(round(100.0 / rate) * rate, 100.0)):
        raise RvadsError(f"{_dest('sut-rate')} must divide 100, such as 10, 20, 25 or 50, got {value!r}")
    return rate


def _speed(value: str) -> float | None:
    """Return a speed limit [m/s], or None where nothing was said."""
    if not value:  # as in most sessions, which then need not load what reads maps
        return None
    from pytest_rvads.opendrive.speeds import speed_of

    return speed_of(value, _dest("speed-limit"))


def _reports(config: pytest.Config, here: Path) -> tuple[Path, ...]:
    names: list[str] = config.getoption("rvads_report") or config.getini("rvads_report")
    if not names:  # as in most sessions of an environment, which then need not load what writes reports
        return ()
    from pytest_rvads.report.files import FORMATS

    for name in names:
        if Path(name).suffix not in FORMATS:
            raise RvadsError(f"rvads_report must name a {', '.join(FORMATS)} file, got {name!r}")
    return tuple(here / name for name in names)


def _baseline(values: dict[str, str], here: Path) -> Path | None:
    if values["baseline"]:
        return here / values["baseline"]
    if values["fail-on"] != "any":
        raise RvadsError(f"rvads_fail_on={values['fail-on']} needs something to compare with: add --rvads-baseline=FILE.json")
    return None


def _command(value: str, here: Path) -> tuple[str, ...] | None:
    """Return the words of a command whose program exists."""
    try:
        words = shlex.split(value)
    except ValueError as error:
        raise RvadsError(f"rvads_sut can't be read as a command: {error}, got {value!r}") from error
    if not words:
        return None
    program = shutil.which(str(here / words[0]) if "/" in words[0] else words[0])
    if program is None:
        raise RvadsError(f"rvads_sut must be the command of a program that exists and may be executed, got {value!r}")
    return (program, *words[1:])


def _map(config: pytest.Config) -> str | None:
    """Return the map file: the flag and the variable count from the working directory, the ini from its own."""
    flag = config.getoption("rvads_map") or os.environ.get("RVADS_MAP")
    if flag:
        return str(Path(flag).resolve())
    ini = config.getini("rvads_map")
    return str((config.rootpath / ini).resolve()) if ini else None
