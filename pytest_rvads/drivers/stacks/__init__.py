"""Autopilots in other processes, called stacks: programs in any language that get observations and return commands by pipes.

Simulated time waits for each answer (lock-step).
"""
