"""Rules: the words they are written in, their shapes, the books they stand in."""
