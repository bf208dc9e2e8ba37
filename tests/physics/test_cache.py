"""The cache on disk: whatever lies there, the number is the one that would be computed."""

import json
import os
import resource
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from pytest_rvads.physics import braking
from pytest_rvads.physics.braking import vmax
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.support import installed


@pytest.fixture(autouse=True)
def where(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(braking.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


class Counter:
    """Computes a number and counts how often it was asked to."""

    def __init__(self, value: float | None) -> None:
        self.value = value
        self.asked = 0

    def __call__(self) -> float | None:
        self.asked += 1
        return self.value


@pytest.mark.parametrize("value", [0.1 + 0.2, 0.0, -1e-300, None])
def test_a_number_is_computed_once_and_comes_back_bit_for_bit(value: float | None) -> None:
    compute = Counter(value)
    assert [braking.cached({"a": 1}, compute) for _ in range(3)] == [value] * 3
    assert compute.asked == 1
    assert braking.cached({"a": 2}, Counter(5.0)) == 5.0, "another key"


def other_number(text: str) -> str:
    return text.replace("0.5", "0.7")


def not_finite(text: str) -> str:
    return braking._entry(json.loads(text.split("\n")[1])["key"], float("nan"))


def other_key(text: str) -> str:
    return braking._entry("another", 0.7)


DAMAGE: list[Callable[[str], str]] = [
    lambda text: "",
    lambda text: text[:-5],
    lambda text: text * 2,
    lambda text: "[" * 100_000,
    lambda text: "x\n" + '{"value": "fast"}',
    lambda text: "x\n[0.7]",
    other_number,
    not_finite,
    other_key,
]


@pytest.mark.parametrize("damage", DAMAGE, ids=range(len(DAMAGE)))
def test_a_damaged_entry_counts_as_absent(where: Path, damage: Callable[[str], str]) -> None:
    braking.cached({"a": 1}, Counter(0.5))
    (entry,) = where.iterdir()
    entry.write_text(damage(entry.read_text()))
    compute = Counter(0.5)
    assert braking.cached({"a": 1}, compute) == 0.5
    assert compute.asked == 1
    assert braking.cached({"a": 1}, compute) == 0.5
    assert compute.asked == 1, "mended"


def test_what_can_t_be_kept_is_computed_all_the_same(where: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    where.write_text("a file where the folder should be")
    assert braking.cached({"a": 1}, Counter(0.5)) == 0.5
    monkeypatch.setenv(braking.VARIABLE, "")
    compute = Counter(0.5)
    assert [braking.cached({"a": 1}, compute) for _ in range(2)] == [0.5, 0.5]
    assert compute.asked == 2, "switched off"
    assert braking.folder() is None


def test_an_entry_that_is_a_folder_is_left_alone(where: Path) -> None:
    braking.cached({"a": 1}, Counter(0.5))
    (entry,) = where.iterdir()
    entry.unlink()
    entry.mkdir()
    assert braking.cached({"a": 1}, Counter(0.5)) == 0.5
    assert list(where.iterdir()) == [entry], "nothing half-written stays behind"


def pipe(entry: Path) -> None:
    entry.unlink()
    os.mkfifo(entry)


def link_without_end(entry: Path) -> None:
    entry.unlink()
    entry.symlink_to("/dev/zero")


def link_to_a_file(entry: Path) -> None:
    elsewhere = entry.parent.with_name("precious")
    elsewhere.write_text("to be kept")
    entry.unlink()
    entry.symlink_to(elsewhere)


def huge(entry: Path) -> None:
    os.truncate(entry, 2**32)


@pytest.mark.parametrize("put", [pipe, link_without_end, link_to_a_file, huge])
def test_what_is_no_small_regular_file_is_neither_read_nor_written_to_but_replaced(
    where: Path, put: Callable[[Path], None]
) -> None:
    braking.cached({"a": 1}, Counter(0.5))
    (entry,) = where.iterdir()
    put(entry)
    compute = Counter(0.5)
    assert [braking.cached({"a": 1}, compute) for _ in range(2)] == [0.5, 0.5]
    assert compute.asked == 1
    assert entry.stat().st_size < 10_000
    assert not entry.is_symlink()
    elsewhere = where.with_name("precious")
    assert not elsewhere.exists() or elsewhere.read_text() == "to be kept"


def test_a_full_disk_costs_no_number(where: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))  # no file may have anything in it
    try:
        assert braking.cached({"a": 1}, Counter(0.5)) == 0.5
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(where.iterdir()) == []


def test_an_error_is_not_kept() -> None:
    def fail() -> float:
        raise ValueError("no number")

    with pytest.raises(ValueError, match="no number"):
        braking.cached({"a": 1}, fail)
    assert braking.cached({"a": 1}, Counter(0.5)) == 0.5


def test_other_code_and_other_versions_are_other_keys(where: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    braking.cached({"a": 1}, Counter(0.5))
    monkeypatch.setattr(braking, "code", lambda: "changed")
    assert braking.cached({"a": 1}, Counter(0.7)) == 0.7
    monkeypatch.setattr(braking, "versions", lambda: {"pybullet": "99"})
    assert braking.cached({"a": 1}, Counter(0.9)) == 0.9
    assert len(list(where.iterdir())) == 3


def test_the_code_is_told_by_a_checksum_of_every_module(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = []
    for text in ("x = 1", "x = 2"):
        (tmp_path / "package" / "room").mkdir(parents=True, exist_ok=True)
        (tmp_path / "package" / "module.py").write_text(text)
        monkeypatch.setattr(installed, "__file__", str(tmp_path / "package" / "installed.py"))
        found.append(installed.code.__wrapped__())
    assert all(len(checksum) == 64 for checksum in found)
    assert found[0] != found[1]


def _many(place: str) -> list[float | None]:
    os.environ[braking.VARIABLE] = place
    return [braking.cached({"a": k % 5}, Counter(float(k % 5))) for k in range(200)]


@pytest.mark.extended
def test_processes_that_write_at_the_same_time_do_not_hurt_each_other(where: Path) -> None:
    with ProcessPoolExecutor(4, initializer=signal.alarm, initargs=(60,)) as pool:
        found = list(pool.map(_many, [str(where)] * 4))
    assert found == [[float(k % 5) for k in range(200)]] * 4
    assert len(list(where.iterdir())) == 5
    assert all(path.suffix == ".json" for path in where.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="the variables of Linux")
def test_by_default_it_lies_in_the_user_s_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(braking.VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert braking.folder() == tmp_path / "pytest-rvads"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert braking.folder() == tmp_path / ".cache" / "pytest-rvads"
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    assert braking.folder() is None, "nobody's home"


def test_envelope_cache_key_holds_distance_aggression_and_vehicle(where: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    car = Vehicle(mass=1501.0)
    braking._vmax.cache_clear()
    first = vmax(3.3, 2, car)
    braking._vmax.cache_clear()
    monkeypatch.setattr(braking, "_bisected", lambda *_: pytest.fail("tested again"))
    assert vmax(3.3, 2, car) == first
    monkeypatch.setattr(braking, "_bisected", lambda *_: 1.0)
    assert [vmax(3.4, 2, car), vmax(3.3, 1, car), vmax(3.3, 2, Vehicle(mass=1502.0))] == [1.0] * 3
    braking._vmax.cache_clear()
