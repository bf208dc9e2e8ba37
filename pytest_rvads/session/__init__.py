"""A session of pytest: what it planned, what came of it, how it ends."""
