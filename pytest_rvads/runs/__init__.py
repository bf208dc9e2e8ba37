"""Runs (sequences of states of vehicles and lights; paper, section 4.2), and files of runs."""
