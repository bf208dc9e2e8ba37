"""Reports: what is said of verdicts, from plain records."""
