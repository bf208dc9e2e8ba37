"""Whether a campaign gets slower or larger as it goes on: CPU time per run and memory of all processes, every thousand runs.

python benchmarks/bench_campaign.py [RUNS [PROCESSES [DURATION]]]
"""

import math
import multiprocessing
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest_rvads as rvads

EVERY = 1000


def cases(runs: int, duration: float) -> Iterator[rvads.Case]:
    """Yield cases that all differ, two vehicles each."""
    place = rvads.find("stop4")
    for k in range(runs):
        distance = 5.0 + 15.0 * k / runs
        yield rvads.Case(rvads.Scenario(place, "1010", distance=distance, duration=duration), rvads.Reference)


def resident(process: int) -> float:
    """Return the memory that a process holds [MB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def busy(process: int) -> float:
    """Return the CPU time that a process has used [s]."""
    told = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


def main(runs: int = 20_000, processes: int = 2, duration: float = 1.0) -> None:
    """Run a campaign and print a row per thousand runs."""
    used = [0.0]

    def tell(done: int, _: int) -> None:
        if done % EVERY == 0:
            all_of_us = [os.getpid(), *(process.pid for process in multiprocessing.active_children() if process.pid)]
            before, used[0] = used[0], math.fsum(map(busy, all_of_us))
            held = "  ".join(f"{resident(process):6.1f} MB" for process in all_of_us)
            print(f"{done:6} runs  {1000 * (used[0] - before) / EVERY:7.2f} ms each  {held}", flush=True)

    with rvads.campaign(cases(runs, duration), executor=processes, progress=tell, total=runs) as results:
        print(f"{len(results)} results, {results.verdicts} verdicts")


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((int, int, float), sys.argv[1:], strict=False)))
