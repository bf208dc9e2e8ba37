"""Campaigns: many cases, judged on many processes and machines, with results on disk as they arrive."""
