"""pytest-rvads: validate autonomous-driving controllers against traffic rules, in pytest."""
