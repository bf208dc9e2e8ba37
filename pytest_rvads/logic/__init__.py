"""Logic: formulas, LTL3 monitors, rules, verdicts."""
