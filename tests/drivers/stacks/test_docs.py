"""The page on attaching a stack tells the truth: what it says a script prints, what it counts, what it names."""

import contextlib
import io
import re
from dataclasses import fields
from pathlib import Path

from pytest_rvads.drivers.traffic import policies
from pytest_rvads.scenarios.senses import Senses
from pytest_rvads.session.options import Options

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "attach-your-stack.md").read_text(encoding="utf-8")


def test_script_of_the_page_prints_its_comments() -> None:
    (code,) = [block for block in re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL) if "print(" in block]
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, "attach-your-stack.md", "exec"), {})
    assert out.getvalue().splitlines() == re.findall(r"^print\(.*\)  # (.*)$", code, re.MULTILINE)


def test_page_names_policies_senses_and_options() -> None:
    for name in [*policies(), *(item.name for item in fields(Senses))]:
        assert f"`{name}`" in TEXT or f'`"{name}"`' in TEXT, name
    for name, shown in {
        "sut": "--rvads-sut ",
        "sut_rate": "--rvads-sut-rate ",
        "sut_timeout": "--rvads-sut-timeout ",
    }.items():
        assert name in Options.__dataclass_fields__
        assert f"| `{shown}" in TEXT


def test_examples_have_the_lengths_on_the_page() -> None:
    lines = len((ROOT / "clients" / "c" / "example.cpp").read_text(encoding="utf-8").splitlines())
    assert f"`example.cpp` ({lines} lines)" in TEXT
    assert lines <= 40
    assert len((ROOT / "clients" / "python" / "example.py").read_text(encoding="utf-8").splitlines()) <= 30
