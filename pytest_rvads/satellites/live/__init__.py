"""Judges rules on a run while the run is being produced, one state at a time."""
