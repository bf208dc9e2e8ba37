"""Simulators: what makes a run of a case."""
