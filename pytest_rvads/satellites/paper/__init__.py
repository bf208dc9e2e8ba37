"""Reproduces the experiment of the paper: its two tables, and evidence on how robust the reproduction is."""
