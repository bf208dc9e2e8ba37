"""What vehicles do to each other in a run, measured: predicates, priority, progress, blame."""
