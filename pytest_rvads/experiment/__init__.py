"""The experiment of the paper: its two tables, replicated with a calibrated surrogate."""
