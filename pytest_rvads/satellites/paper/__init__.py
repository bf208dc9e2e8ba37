"""The experiment of the paper: its two tables, and how firmly they are reproduced."""
