"""Sessions of pytest inside pytest, with a controller that breaks p1 and full_stop within a second."""

from collections.abc import Callable

import pytest

from tests.inner_sessions import driven_by

CONFTEST = driven_by(
    'DRIVERS["{driver}"]',
    """
    class Raises(Racer):
        def control(self, seen):
            if seen.time > 0.1:
                raise ZeroDivisionError("no gap found")
            return super().control(seen)

    DRIVERS = {{"racer": Racer, "raises": Raises, "reference": rvads.Reference}}
    DRIVERS |= {{f"pilot as {{name}}": type("Pilot", (driver,), {{}}) for name, driver in DRIVERS.items()}}
""",
)
HEAD = """
import contextlib
import pytest
import pytest_rvads as rvads

def here(**more):
    return rvads.scenario("stop4", **{"classes": 7, "grid": "B", "rules": "p1", "duration": 2, **more})

"""

Session = Callable[..., pytest.RunResult]


@pytest.fixture
def session(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Session:
    """Return a function that runs a session, in this process, with one file of tests and a controller by name.

    In the file `here(...)` is a cheap scenario of four vehicles at an all-way stop, to be judged by p1 if nothing else is said.
    """
    for name in ("RVADS_MAP", "PYTEST_ADDOPTS", "GITHUB_STEP_SUMMARY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("COLUMNS", "200")

    def run(tests: str, *options: str, driver: str | None = "racer", name: str = "test_it") -> pytest.RunResult:
        if driver:
            pytester.makeconftest(CONFTEST.format(driver=driver))
        (pytester.path / f"{name}.py").write_text(HEAD + tests, encoding="utf-8")
        return pytester.runpytest("--rvads-report=out.json", *options)

    return run
