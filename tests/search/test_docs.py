"""The Python code of docs/search.md runs."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs" / "search.md"
BLOCKS = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.extended
@pytest.mark.parametrize("block", BLOCKS, ids=[str(k) for k in range(len(BLOCKS))])
def test_code_in_the_documentation_runs(block: str, pytester: pytest.Pytester) -> None:
    pytester.makepyfile(block if "def test_" in block else "def test_block():\n" + re.sub("(?m)^", "    ", block))
    result = pytester.runpytest("-p", "no:cacheprovider")
    assert result.ret == 0
