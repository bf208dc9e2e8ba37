"""Reports on sessions and campaigns, made from records of test items."""
