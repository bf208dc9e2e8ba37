"""Autopilots in other processes: a stack in any language, asked in lock-step over its standard input and output."""
