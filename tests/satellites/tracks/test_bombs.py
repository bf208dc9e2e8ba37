"""Every reader refuses a small file that unpacks to a very large one, as SECURITY.md promises."""

import gzip
import tracemalloc
from pathlib import Path

import pytest

from pytest_rvads.satellites.tracks.lightlog import read_lights
from pytest_rvads.satellites.tracks.logformats import read_log
from pytest_rvads.support.errors import RunError

HEADS = {
    "t.csv.gz": b"time,id,x,y\n",
    "t.jsonl.gz": b"",
    "t.xml.gz": b"<fcd-export>",
    "scenario.xml.gz": b'<commonRoad timeStepSize="0.1">',
    "t.xosc": b"<OpenSCENARIO>",
    "lights.csv": b"time,signal,colour\n",
    "lights.xml": b"<tlsStates>",
}
ROWS = {
    "t.csv.gz": b"1,v,%d,0",
    "t.jsonl.gz": b'{"type": "weather", "n": %d}\n',
    "t.xml.gz": b'<timestep time="%d"/>\n',
    "scenario.xml.gz": b'<dynamicObstacle id="%d"/>',
    "t.xosc": b"<!-- %d -->",
    "lights.csv": b"%d,s,red",
    "lights.xml": b'<tlsState time="%d" id="a" state=""/>\n',
}
LINES = [name for name in HEADS if b"<" not in HEADS[name]]


def read(folder: Path, name: str, content: bytes) -> None:
    """Read a packed file, and check that reading takes at most a quarter of a gigabyte."""
    path = folder / name
    path.write_bytes(gzip.compress(HEADS[name] + content, 9))
    assert path.stat().st_size < 100_000
    tracemalloc.start()
    try:
        read_lights(path) if name.startswith("lights") else read_log(path)
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 2**28


@pytest.mark.parametrize("name", [name for name in HEADS if name not in LINES])
def test_nested_tags(tmp_path: Path, name: str) -> None:
    with pytest.raises(RunError, match=rf"{name}: row 1: elements are nested deeper than 60 levels"):
        read(tmp_path, name, b"<a>" * 1_000_000)


@pytest.mark.parametrize("name", LINES)
def test_blank_lines(tmp_path: Path, name: str) -> None:
    with pytest.raises(RunError, match=rf"{name}: row \d+: 100,00\d of the rows up to here are empty"):
        read(tmp_path, name, b"\n" * 1_000_000)


@pytest.mark.parametrize("name", HEADS)
def test_bytes_as_unpacked(tmp_path: Path, name: str) -> None:
    rows = b"".join(ROWS[name] % number + b" " * 30_000 + b"\n" for number in range(600))
    with pytest.raises(RunError, match=rf"{name}: .* unpacks to more than 16,777,216 bytes"):
        read(tmp_path, name, rows)
