"""Puts verdicts into words."""
