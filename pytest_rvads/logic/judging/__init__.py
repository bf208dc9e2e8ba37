"""Judging a run by a rule: grounding, monitoring, whose doing it was."""
