"""Whatever is asked of ``rvads monitor --jsonl``, one line of strict JSON answers it."""

import json

from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.logic.ltl.export import answer

from .mutations import QUICK, damaged, hostile_json

SEED = json.dumps({"id": "x7", "formula": "[](p -> q U r)", "words": [[["p", "q"], ["q"], ["r"]], [[], ["p"]]]}).encode()


def no_number(constant: str) -> None:
    raise AssertionError(f"{constant} is not JSON")


@given(line=damaged(SEED) | hostile_json.map(lambda value: json.dumps(value).encode()) | st.binary(max_size=50))
@QUICK
def test_tasks(line: bytes) -> None:
    told = json.dumps(answer(line), allow_nan=False)
    assert "\n" not in told
    found = json.loads(told, parse_constant=no_number)
    assert found.keys() in ({"id", "error"}, {"id", "states", "verdicts", "finite"})
    json.dumps(found, ensure_ascii=False).encode()
