"""Judges a run by a rule: instances of the rule, their monitors, and the vehicles that are responsible."""
