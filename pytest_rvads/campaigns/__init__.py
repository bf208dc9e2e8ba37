"""Campaigns: many cases, judged on as many processes and machines as there are, with results on disk as they come."""
