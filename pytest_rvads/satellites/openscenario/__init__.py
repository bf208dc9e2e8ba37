"""OpenSCENARIO XML for others: runs as trajectories, scenarios to be driven by somebody else's controller."""
