"""What drives where an example brings no autopilot of its own: the examples ask for the reference autopilot that is bundled.

Yours goes into the same place. Without such a fixture a session tests nothing of yours, says so, and is not green.
"""

import pytest

import pytest_rvads as rvads


@pytest.fixture(scope="session")
def rvads_autopilot():
    """Return the system under test."""
    return rvads.Reference
