"""The options of the plugin: each a ``--rvads-*`` flag with an ini twin ``rvads_*``, read once into one frozen object."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.errors import RvadsError
from pytest_rvads.report.files import FORMATS

if TYPE_CHECKING:
    import pytest

__all__ = ["Options", "declare"]

_DECLARED: dict[str, tuple[str, str, tuple[str, ...] | None]] = {
    "map": ("", "OpenDRIVE file for junctions that are not built in (also the variable RVADS_MAP)", None),
    "cover": ("", "what to run of every class where a test does not say", ("class", "scenario", "rotation")),
    "grid": ("", "configurations where a test does not say: 'paper' or letters such as CD", None),
    "max-items": ("10000", "refuse a test that would expand to more items than this", None),
    "rules": ("", "file with rules of your own, see `rvads rules --file`", None),
    "keep": ("", "folder to keep every run in, as .npz for `rvads check`", None),
    "report": ("", "also write the verdicts to FILE.json or FILE.md", None),
    "artefacts": (".rvads", "folder for the replay pages of failures, or 'none'", None),
    "open": ("fail", "what an obligation still open at the end of a run does to its test", ("fail", "skip", "pass")),
}


@dataclass(frozen=True, slots=True)
class Options:
    """What was asked for on the command line, in the environment or in the configuration file, in this order."""

    map: str | None
    cover: str
    grid: str
    max_items: int
    rules: Path | None
    keep: Path | None
    report: Path | None
    artefacts: str | None
    open: str

    @classmethod
    def read(cls, config: pytest.Config) -> Options:
        """Read the options of a session.

        Raises:
            RvadsError: a value out of range.
        """
        values: dict[str, str] = {}
        for name, (default, _, choices) in _DECLARED.items():
            dest = f"rvads_{name.replace('-', '_')}"
            value = config.getoption(dest) or config.getini(dest) or default
            if choices and value and value not in choices:
                raise RvadsError(f"{dest} must be one of {', '.join(choices)}, got {value!r}")
            values[name] = value
        count = values["max-items"]
        if not (count.isdecimal() and int(count) > 0):
            raise RvadsError(f"rvads_max_items must be a whole number above 0, got {count!r}")
        report = values["report"]
        if report and Path(report).suffix not in FORMATS:
            raise RvadsError(f"rvads_report must name a {' or '.join(FORMATS)} file, got {report!r}")
        return cls(
            map=_map(config),
            cover=values["cover"] or "class",
            grid=values["grid"] or "paper",
            max_items=int(count),
            rules=config.rootpath / values["rules"] if values["rules"] else None,
            keep=config.invocation_params.dir / values["keep"] if values["keep"] else None,
            report=config.invocation_params.dir / report if report else None,
            artefacts=None if values["artefacts"] == "none" else values["artefacts"],
            open=values["open"],
        )


def declare(parser: pytest.Parser) -> None:
    """Add every option and its ini twin to pytest's parser."""
    group = parser.getgroup("rvads", "traffic-rule validation (pytest-rvads)")
    for name, (default, text, choices) in _DECLARED.items():
        dest = f"rvads_{name.replace('-', '_')}"
        more: dict[str, Any] = {"choices": choices} if choices else {"metavar": name.rpartition("-")[2].upper()}
        help_text = f"{text} (ini: {dest}{f', default {default}' if default else ''})"
        group.addoption(f"--rvads-{name}", dest=dest, default=None, help=help_text, **more)
        parser.addini(dest, help=text, default="")


def _map(config: pytest.Config) -> str | None:
    """Return the map file: the flag and the variable count from the working directory, the ini from its own."""
    flag = config.getoption("rvads_map") or os.environ.get("RVADS_MAP")
    if flag:
        return str(Path(flag).resolve())
    ini = config.getini("rvads_map")
    return str((config.rootpath / ini).resolve()) if ini else None
