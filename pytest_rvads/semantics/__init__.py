"""The semantic model (G, S) of the paper: states, runs, itineraries, lights."""
