"""Imports logs of recorded traffic: each vehicle is matched to a way (a path through a junction), and noise is smoothed away."""
