"""Runs: the states of vehicles and lights (paper, section 4.2), their files."""
