"""Whatever happens to a file of runs, it is read or refused in one sentence; what is read can be judged, drawn and kept."""

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.logic.conduct.validate import damage, validate
from pytest_rvads.report.scene import picture
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run, save_run
from pytest_rvads.satellites.pages.replay import replay
from pytest_rvads.support.errors import RunError

from .mutations import QUICK, damaged

RULES = ("p2", "p6", "first_come", "no_collision", "no_conflict", "keep_lane", "progress", "speed_limit")
NUMBERS = st.sampled_from([float("nan"), float("inf"), 0.0, -1.0, 1e8, 1e9, 1e300, -1e-300, 127.0, 2.0**40])
pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def kept(drive: Callable[..., Run], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("kept") / "run.npz"
    vehicles = {0: (2, -8.0, [(0, 6.0)]), 1: (1, -3.0, [(0, 4.0), (20, 0.0)]), 2: (3, -20.0, [(0, 9.0)])}
    save_run(drive("light4", vehicles, 60, collisions=[(30, "a0", "a1")]), path)
    return path.read_bytes()


def survive(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        runs = read_runs(path)
    except RunError as error:
        message = str(error)
    else:
        for run in runs:
            use(run, path.with_name("again.npz"))
        return
    assert "\n" not in message
    assert path.name in message
    assert len(message) < 1000


def use(run: Run, path: Path) -> None:
    validate(run)
    for rule in RULES:
        str(check(run, rule))
    if not damage(run):
        json.dumps(kpis(run).record(), allow_nan=False)
        if run.pose is not None and run.junction.drivable:
            picture(run, run.steps // 2, "broken", ())
            replay(run, "broken", "", [(run.duration / 2, "broken")], (), ())
    save_run(run, path)
    assert load_run(path).hash == run.hash


@given(data=st.data())
@QUICK
def test_kept_runs_with_other_bytes(kept: bytes, tmp_path: Path, data: st.DataObject) -> None:
    survive(tmp_path / "run.npz", data.draw(damaged(kept)))


@given(data=st.data())
@QUICK
def test_kept_runs_with_other_members(kept: bytes, tmp_path: Path, data: st.DataObject) -> None:
    with zipfile.ZipFile(io.BytesIO(kept)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = data.draw(st.sampled_from(sorted(members)))
    members[name] = data.draw(damaged(members[name]))
    survive(tmp_path / "run.npz", zipped(members))


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_kept_runs_with_another_header(kept: bytes, tmp_path: Path, data: st.DataObject) -> None:
    arrays = unpacked(kept)
    arrays["header"] = np.frombuffer(data.draw(damaged(arrays["header"].tobytes())), np.uint8)
    survive(tmp_path / "run.npz", packed(arrays))


@st.composite
def changed(draw: st.DrawFn, array: Any) -> Any:
    """Draw an array with another number in it, of another size, of another kind, cut, or turned."""
    what = draw(st.sampled_from(["number", "factor", "kind", "less", "turned"]))
    if what == "number":
        other = array.copy()
        other.flat[draw(st.integers(0, array.size - 1))] = draw(NUMBERS if array.dtype.kind == "f" else st.integers(-128, 127))
        return other
    if what == "factor":
        return array * draw(NUMBERS)
    if what == "kind":
        return array.astype(draw(st.sampled_from(["i1", "i8", "u2", "f4", ">f8", "c8", "U3"])))
    return array[: draw(st.integers(0, 2))] if what == "less" else array.T


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_kept_runs_with_other_numbers(kept: bytes, tmp_path: Path, data: st.DataObject) -> None:
    arrays = unpacked(kept)
    for name in data.draw(st.lists(st.sampled_from(sorted(arrays.keys() - {"header"})), min_size=1, max_size=3, unique=True)):
        with np.errstate(all="ignore"):
            arrays[name] = data.draw(changed(arrays[name]))
    survive(tmp_path / "run.npz", packed(arrays))


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_recordings(shared: Path, tmp_path: Path, data: st.DataObject) -> None:
    content: dict[str, Any] = json.loads((shared / "runs" / "4-way-light.json").read_bytes())
    seed = json.dumps({**content, "runs": content["runs"][:2]}).encode()
    survive(tmp_path / "runs.json", data.draw(damaged(seed)))


def unpacked(content: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(content)) as archive:
        return {name: archive[name] for name in archive.files}


def packed(arrays: dict[str, Any]) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def zipped(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()
