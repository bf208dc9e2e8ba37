"""A session of pytest: the planned test items, the records of the items that ran, and the end of the session."""
