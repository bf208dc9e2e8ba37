"""Whatever lies in the cache of v(d)max, the number is the one that would be computed."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.physics import braking

from .mutations import QUICK, damaged


@given(data=st.data())
@QUICK
def test_entries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: st.DataObject) -> None:
    monkeypatch.setenv(braking.VARIABLE, str(tmp_path))
    braking.cached({"a": 1}, lambda: 0.5)
    (entry,) = tmp_path.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(data.draw(damaged(whole)))
    assert braking.cached({"a": 1}, lambda: 0.5) == 0.5
    assert entry.read_bytes() == whole, "mended"
