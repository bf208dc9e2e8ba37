"""Reads map files in a process with bounds on memory and processor time, as a reader with a bound on work needs."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

_SCRIPT = """
import json, resource, sys
resource.setrlimit(resource.RLIMIT_CPU, (40, 40))
from pytest_rvads.geometry.road_map import describe, read_map
from pytest_rvads.support.errors import MapError
resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
for path in sys.argv[1:]:
    try:
        junctions = describe(read_map(path))["junctions"]
        answer = [junction["reason"] or f"{junction['ways']} arms" for junction in junctions][-1]
    except MapError as error:
        answer = str(error)
    print(json.dumps(answer), flush=True)
"""


def answers(files: Sequence[Path]) -> dict[str, str]:
    """Return, per file, the refusal of the file or of its last junction, or else the number of arms of that junction.

    All files together have a gigabyte of memory and 40 s of processor time.
    """
    command = [sys.executable, "-c", _SCRIPT, *map(str, files)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == len(files), f"{files[len(lines)].name} was not read within bounds: {done.stderr[-300:]}"
    return {file.name: line for file, line in zip(files, lines, strict=True)}
