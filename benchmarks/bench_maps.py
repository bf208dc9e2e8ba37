"""Cost of reading maps: built-in junctions, a town, and grids of 10 to 1,000 junctions made by SUMO.

Run with ``pytest benchmarks/bench_maps.py``; the grids need the eclipse-sumo wheel, the town ../shared.
"""

import subprocess
import tracemalloc
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import describe, read_map
from pytest_rvads.report.map_picture import draw_map

TOWN = Path(__file__).parents[1].parent / "shared" / "maps" / "Town04.xodr"
needs_town = pytest.mark.skipif(not TOWN.exists(), reason="the folder ../shared is absent")


def test_built_in(benchmark: BenchmarkFixture) -> None:
    junction = benchmark(lambda: read_map(path_of("stop4")).junction("1"))
    assert junction.ways == 4


@needs_town
def test_town04(benchmark: BenchmarkFixture) -> None:
    road_map = benchmark(read_map, TOWN)
    assert len(road_map.junctions) == 27
    assert benchmark.stats["max"] < 1.0


@needs_town
def test_town04_with_graph_and_picture(benchmark: BenchmarkFixture) -> None:
    def whole() -> int:
        road_map = read_map(TOWN)
        return len(road_map.graph.segments) + len(describe(road_map)) + len(draw_map(road_map))

    assert benchmark.pedantic(whole, rounds=3)


@needs_town
def test_town04_memory() -> None:
    tracemalloc.start()
    road_map = read_map(TOWN)
    assert len(road_map.graph.segments) > 400
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 200e6


@pytest.mark.parametrize("side", [3, 10, 18, 32])
def test_sumo_grid(benchmark: BenchmarkFixture, tmp_path: Path, side: int) -> None:
    sumo = pytest.importorskip("sumo")
    net, out = tmp_path / "grid.net.xml", tmp_path / "grid.xodr"
    tools = Path(sumo.SUMO_HOME) / "bin"
    grid = ["--grid", f"--grid.number={side}", "--grid.length=100", "--grid.attach-length=100", "--no-turnarounds"]
    subprocess.run([str(tools / "netgenerate"), *grid, "-o", str(net)], check=True, capture_output=True)
    subprocess.run([str(tools / "netconvert"), "-s", str(net), "--opendrive-output", str(out)], check=True, capture_output=True)
    road_map = benchmark.pedantic(read_map, args=(out,), rounds=3)
    usable = sum(report.usable for report in road_map.junctions)
    benchmark.extra_info |= {
        "junctions": len(road_map.junctions),
        "usable": usable,
        "ms per junction": benchmark.stats["min"] * 1000 / side**2,
    }
    assert usable == side**2
