"""Scenarios: abstract scenarios and their equivalence classes, concrete scenarios on grids."""
