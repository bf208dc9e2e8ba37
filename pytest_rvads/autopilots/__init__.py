"""Autopilots that ship with the project: systems under test and helpers to write one."""
