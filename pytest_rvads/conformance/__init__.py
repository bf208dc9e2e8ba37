"""The tests that a simulator has to pass: ``pytest --pyargs pytest_rvads.conformance --rvads-simulator=module:name``."""
