"""Measures how the vehicles of a run interact: predicates of rules, right of way, progress, blame."""
