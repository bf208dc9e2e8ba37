"""The example of the paper's tables: the configurations that need all five deficiencies but I1."""

from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[3] / "examples" / "test_6_the_papers_tables.py"


@pytest.mark.extended
def test_marks_name_the_deficiency_behind_every_failing_cell(pytester: pytest.Pytester) -> None:
    pytester.copy_example(str(EXAMPLE))
    result = pytester.runpytest("-k", "cfgE or cfgJ", "-rx")
    # E: p1 fails in 6 of 8 rows, p2 in all. J: p5 in the 4 rows of class 4, p6 in the 4 of class 3.
    assert result.parseoutcomes()["xfailed"] == 6 + 8 + 4 + 4
    assert result.ret == 0
    named = {line.split(" - ")[1].split(":")[0] for line in result.outlines if line.startswith("XFAIL ")}
    assert named == {"I2", "I3", "I4", "I5"}


@pytest.mark.extended
def test_repaired_deficiency_fails_the_example(pytester: pytest.Pytester) -> None:
    source = EXAMPLE.read_text().replace("return LgsvlLike", "return partial(LgsvlLike, i3=False)")
    pytester.makepyfile(test_repaired="from functools import partial\n" + source.replace('"""The', 'TEXT = """The', 1))
    result = pytester.runpytest("-k", "test_stop and cfgE and p2", "--rvads-artefacts=none")
    assert result.parseoutcomes()["failed"] == 8, "a strict xfail that passes is a failure"
