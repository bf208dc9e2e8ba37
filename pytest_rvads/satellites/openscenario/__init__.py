"""Reads and writes OpenSCENARIO XML: runs as trajectories, and scenarios for controllers in other simulators."""
