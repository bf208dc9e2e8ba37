"""Judges runs by traffic rules: formulas, LTL3 monitors, rules, verdicts."""
