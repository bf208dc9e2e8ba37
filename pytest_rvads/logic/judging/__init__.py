"""Judging a run by a rule: grounding, monitoring, attribution to vehicles."""
