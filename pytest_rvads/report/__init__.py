"""Reports on sessions and campaigns, made from plain records."""
