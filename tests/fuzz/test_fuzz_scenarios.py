"""Whatever happens to a file that we exported, it is read or refused in one sentence."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.runs.recording import Recording
from pytest_rvads.support.errors import MapError, RunError, ScenarioError

from .mutations import QUICK, damaged, hostile_text

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run, a scenario, and their map."""
    pytest.importorskip("scenariogeneration")
    found = tmp_path_factory.mktemp("exported")
    scenario = rvads.Scenario(rvads.find("light4"), "2010", distance=1.0, duration=0.5)
    rvads.files.save_scenario(scenario, found / "scenario.xosc")
    rvads.files.export_run(rvads.simulate(rvads.Case(scenario, rvads.Reference)), found / "run.xosc")
    return found


def told(error: Exception) -> None:
    assert "\n" not in str(error)
    assert len(str(error)) < 1500


def read(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        runs = rvads.files.read_runs(path)
    except (RunError, MapError) as error:
        told(error)
    else:
        for run in runs[:1] if isinstance(runs, Recording) else runs:
            str(rvads.check(run, "p4"))
            str(rvads.check(run, "no_collision"))
    try:
        rvads.files.load_scenario(path).starts()
    except (ScenarioError, MapError) as error:
        told(error)


@pytest.mark.extended
@pytest.mark.parametrize("name", ["run.xosc", "scenario.xosc"])
@given(data=st.data())
@QUICK
def test_exports_with_other_bytes(folder: Path, name: str, data: st.DataObject) -> None:
    read(folder / "damaged.xosc", data.draw(damaged((folder / name).read_bytes())))


@pytest.mark.parametrize("name", ["run.xosc", "scenario.xosc"])
@given(data=st.data())
@QUICK
def test_exports_with_other_values(folder: Path, name: str, data: st.DataObject) -> None:
    """Values in quotes, and in the properties in quotes that are escaped, are other ones or gone."""
    text = (folder / name).read_text("utf-8")
    for _ in range(data.draw(st.integers(1, 3))):
        quote = data.draw(st.sampled_from(['"', "&quot;", ":", ","]))
        parts = text.split(quote)
        at = data.draw(st.integers(0, len(parts) - 1))
        numbers = st.sampled_from(["-1", "0", "nan", "1e300", "1e-9", "99999999", "null", "[]", "true", "red"])
        parts[at] = data.draw(numbers | hostile_text)
        text = quote.join(parts)
    read(folder / "damaged.xosc", text.encode("utf-8", "replace"))
