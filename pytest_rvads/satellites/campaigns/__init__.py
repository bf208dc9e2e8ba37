"""Campaigns: many cases are simulated and judged on many processes and machines, and results are written to disk at once."""
