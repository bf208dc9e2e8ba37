"""Simulators, which make the run of a case (a scenario with drivers and vehicles)."""
