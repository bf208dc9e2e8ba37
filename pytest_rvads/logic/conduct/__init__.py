"""The interactions of vehicles in a run, measured: predicates, priority, progress, blame."""
