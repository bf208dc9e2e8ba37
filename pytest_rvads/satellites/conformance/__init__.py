"""Tests for simulators: ``pytest --pyargs pytest_rvads.satellites.conformance --rvads-simulator=module:name``."""
