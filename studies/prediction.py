"""``python -m studies.prediction``: simulate scenarios at junctions that are given by the lengths of their ways."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from pytest_rvads.cli import answer
from pytest_rvads.cli.common import progress, say
from pytest_rvads.simulators.simulator import named
from studies import requests
from studies.predicted import compare, text_agreement


def main(words: Sequence[str] | None = None) -> int:
    """Run the command with these words, by default those of the command line, and return the exit status."""
    prediction = argparse.ArgumentParser(
        prog="python -m studies.prediction",
        description="Simulate scenarios at junctions that are given by the lengths of their ways.",
    )
    what = prediction.add_mutually_exclusive_group(required=True)
    what.add_argument("--jsonl", action="store_true", help="read a JSON object per line, write one for each")
    what.add_argument("--recorded", metavar="FILE", nargs="+", help="simulate the runs of recorded files and compare")
    prediction.add_argument("--simulator", metavar="NAME", help="what makes the runs, a name or module:name")
    prediction.set_defaults(command=_predict)
    return answer(prediction, words)


def _predict(options: argparse.Namespace) -> int:
    simulator = named(options.simulator, Path.cwd())  # an unknown one is refused before anything runs
    if options.recorded:
        for name in options.recorded:
            say(text_agreement(compare(name, simulator=options.simulator, progress=progress), name))
        return 0
    for line in filter(bytes.strip, sys.stdin.buffer):
        print(requests.answer(line.decode("utf-8", errors="replace"), simulator), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
